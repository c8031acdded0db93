# The core: freestanding C99. Makefile, meson.build, CMakeLists.txt read this: plain assignments only, paths
# from the top of the tree.
LIB_SOURCES := lib/cpu.c lib/dispatch.c lib/exec.c lib/exec_difference.c lib/exec_edges.c lib/exec_grain.c lib/exec_images.c lib/exec_layers.c \
               lib/exec_calm.c lib/exec_mix.c lib/exec_patches.c lib/exec_regression.c lib/exec_residual.c lib/exec_winograd.c lib/exposure.c lib/fill.c lib/filter.c lib/graph.c lib/graph_query.c lib/image.c lib/nlm.c lib/pack.c lib/pack_patches.c lib/pack_winograd.c \
               lib/plan.c lib/plan_rows.c lib/status.c lib/transfer.c lib/tza.c
