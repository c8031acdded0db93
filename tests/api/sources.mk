# C test programs of this folder.
TESTS += test_device test_buffer test_filter test_commit test_async test_release test_images \
         test_process test_fuzz_api test_memory test_auto test_ensemble test_panorama test_lightmap
API_COMMON := tests/api/identity.c
TEST_test_device_SOURCES := tests/api/test_device.c $(API_COMMON)
TEST_test_buffer_SOURCES := tests/api/test_buffer.c $(API_COMMON)
TEST_test_filter_SOURCES := tests/api/test_filter.c $(API_COMMON)
TEST_test_commit_SOURCES := tests/api/test_commit.c $(API_COMMON)
TEST_test_async_SOURCES := tests/api/test_async.c $(API_COMMON)
TEST_test_release_SOURCES := tests/api/test_release.c $(API_COMMON)
TEST_test_images_SOURCES := tests/api/test_images.c $(API_COMMON)
TEST_test_process_SOURCES := tests/api/test_process.c $(API_COMMON)
TEST_test_fuzz_api_SOURCES := tests/api/test_fuzz_api.c $(API_COMMON)
TEST_test_memory_SOURCES := tests/api/test_memory.c $(API_COMMON)
TEST_test_memory_LIBS := -Wl,--wrap=malloc,--wrap=free,--wrap=pthread_create
TEST_test_auto_SOURCES := tests/api/test_auto.c $(API_COMMON)
TEST_test_ensemble_SOURCES := tests/api/test_ensemble.c $(API_COMMON)
TEST_test_panorama_SOURCES := tests/api/test_panorama.c $(API_COMMON)
TEST_test_lightmap_SOURCES := tests/api/test_lightmap.c $(API_COMMON)
