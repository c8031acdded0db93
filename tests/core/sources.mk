TESTS += test_run
TEST_test_run_SOURCES := tests/core/test_run.c
TESTS += test_kernel
TEST_test_kernel_SOURCES := tests/core/test_kernel.c
TESTS += test_overlap
TEST_test_overlap_SOURCES := tests/core/test_overlap.c
TESTS += test_limits
TEST_test_limits_SOURCES := tests/core/test_limits.c
