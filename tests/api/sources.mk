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
