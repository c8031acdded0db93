# Conformance of the ports, and their speed (conform --bench).
TESTS += conform
TEST_conform_SOURCES := tests/conform/main.c tests/conform/conform.c tests/conform/cases.c \
                        tests/conform/guard.c tests/conform/bench.c tests/conform/peak.c
