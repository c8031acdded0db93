# The core: freestanding C99. Makefile and meson.build read this file: plain assignments only, paths
# from the top of the tree.
LIB_SOURCES :=
