# C test programs of this folder.
API_COMMON := tests/api/identity.c
TESTS += test_contract
TEST_test_contract_SOURCES := tests/api/test_contract.c $(API_COMMON)
TEST_test_contract_LIBS := -lm
TESTS += test_filter
TEST_test_filter_SOURCES := tests/api/test_filter.c $(API_COMMON)
TEST_test_filter_LIBS := -lm
TESTS += test_behaviour
TEST_test_behaviour_SOURCES := tests/api/test_behaviour.c $(API_COMMON)
TEST_test_behaviour_LIBS := -lm
TESTS += test_memory
TEST_test_memory_SOURCES := tests/api/test_memory.c $(API_COMMON)
TEST_test_memory_LIBS := -lm -Wl,--wrap=malloc,--wrap=free,--wrap=pthread_create
TESTS += test_fuzz_api
TEST_test_fuzz_api_SOURCES := tests/api/test_fuzz_api.c $(API_COMMON)
TEST_test_fuzz_api_LIBS := -lm
