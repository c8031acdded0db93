TESTS += test_golden
TEST_test_golden_SOURCES := tests/golden/test_golden.c
