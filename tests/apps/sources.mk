# The programs' parts, and the image readers on damaged files. Plain assignments only.
TESTS += test_ordered test_parts replay_image
IMAGE_FILES := apps/exr_channels.c apps/exr_file.c apps/exr_keep.c apps/imageio.c \
               apps/imageio_exr.c apps/imageio_hdr.c apps/imageio_pfm.c apps/imageio_png.c \
               apps/imageio_ppm.c apps/layers.c apps/ordered.c apps/platform.c \
               apps/platform_threads.c
TEST_test_ordered_SOURCES := tests/apps/test_ordered.c $(IMAGE_FILES)
TEST_test_parts_SOURCES := tests/apps/test_parts.c apps/compare.c apps/json.c apps/options.c \
                           apps/pattern.c apps/report.c apps/sequence.c $(IMAGE_FILES)
TEST_replay_image_SOURCES := tests/fuzz/replay.c tests/fuzz/fuzz_image.c $(IMAGE_FILES)
