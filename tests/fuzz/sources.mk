# Fuzz targets, linked with a main that replays seeds, so that any compiler runs them. With a fuzzer
# (clang; the sanitizers need a build of the library with the same):
#   make CC=clang SAN=address,undefined,fuzzer-no-link
#   clang -fsanitize=address,undefined,fuzzer -Ilib tests/fuzz/fuzz_tza.c
#       build/san-address-undefined-fuzzer-no-link/lib/liblull.a -o fuzz_tza
#   ./fuzz_tza -max_len=65536 tests/fuzz/seeds/tza
TESTS += replay_tza
TEST_replay_tza_SOURCES := tests/fuzz/replay.c tests/fuzz/fuzz_tza.c
