# C test programs of this folder; each links the whole static library. Paths from the top of the tree.
#   TESTS += <name>           a program; names are unique over all of tests/
#   TEST_<name>_SOURCES       its files
#   TEST_<name>_FLAGS         extra compiler flags (optional)
