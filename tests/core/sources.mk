TESTS += test_run
TEST_test_run_SOURCES := tests/core/test_run.c
