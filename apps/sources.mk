# The programs. Makefile and meson.build read this file: plain assignments only, paths from the top of
# the tree.
APPS :=
APP_COMMON_SOURCES :=
