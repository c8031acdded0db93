TESTS += test_golden
TEST_test_golden_SOURCES := tests/golden/test_golden.c
TESTS += test_schedules
TEST_test_schedules_SOURCES := tests/golden/test_schedules.c
