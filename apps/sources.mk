# Command line tools. Makefile and meson.build read this file: plain assignments only, paths from the
# top of the tree.
#   APPS                  names of the programs
#   APP_<name>_SOURCES    files of one program
#   APP_COMMON_SOURCES    files linked into every program
APPS :=
APP_COMMON_SOURCES :=
