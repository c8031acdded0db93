# The OIDN facade. Makefile and meson.build read this file: plain assignments only, paths from the top
# of the tree.
OIDN_SOURCES :=
