# C test programs of this folder; each links the whole static library. Paths from the top of the
# tree.
#   TESTS += <name>           a program; names are unique over all of tests/
#   TEST_<name>_SOURCES       its files
#   TEST_<name>_FLAGS         extra compiler flags (optional)
#   TEST_<name>_LIBS          extra flags of the linker (optional)
TESTS += test_transfer test_image test_exposure test_tza test_pack test_nlm test_difference test_fill
TEST_test_transfer_SOURCES := tests/unit/test_transfer.c
TEST_test_image_SOURCES := tests/unit/test_image.c
TEST_test_exposure_SOURCES := tests/unit/test_exposure.c
TEST_test_tza_SOURCES := tests/unit/test_tza.c
TEST_test_pack_SOURCES := tests/unit/test_pack.c
TEST_test_nlm_SOURCES := tests/unit/test_nlm.c
TEST_test_difference_SOURCES := tests/unit/test_difference.c
TEST_test_fill_SOURCES := tests/unit/test_fill.c
