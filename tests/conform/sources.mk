# Conformance of the ports, and their speed (conform --bench).
TESTS += conform
TEST_conform_SOURCES := tests/conform/main.c tests/conform/conform.c tests/conform/cases.c \
                        tests/conform/guard.c tests/conform/bench.c tests/conform/peak.c

TESTS += conform_emulated
TEST_conform_emulated_SOURCES := tests/conform/emulate_main.c tests/conform/conform.c \
                                 tests/conform/cases.c tests/conform/guard.c \
                                 tests/conform/emulate_conv_f32_avx2.c \
                                 tests/conform/emulate_conv_int_avx2.c \
                                 tests/conform/emulate_conv_f32_avx512.c \
                                 tests/conform/emulate_conv_int_avx512.c \
                                 tests/conform/emulate_filter_avx2.c \
                                 tests/conform/emulate_head_avx2.c \
                                 tests/conform/emulate_winograd_avx2.c \
                                 tests/conform/emulate_winograd_avx512.c \
                                 tests/conform/emulate_patches_avx2.c \
                                 tests/conform/emulate_patches_avx512.c \
                                 tests/conform/emulate_conv_points_avx2.c \
                                 tests/conform/emulate_conv_points_avx512.c \
                                 tests/conform/emulate_conv_points_avxvnni.c \
                                 tests/conform/emulate_conv_points_vnni.c \
                                 tests/conform/emulate_conv_int_avxvnni.c \
                                 tests/conform/emulate_conv_int_vnni.c \
                                 tests/conform/emulate_conv_int_amx.c
# The emulation is thousands of small functions: at -O3 its files take long to compile.
TEST_conform_emulated_FLAGS := -Wno-psabi -O1
# The same with sanitizers: an hour. The kernels themselves are sanitized through conform.
TESTS_NOT_SANITIZED := conform_emulated
