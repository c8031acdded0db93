# The programs' parts, and the image readers on damaged files. Plain assignments only.
TESTS += test_ordered test_parts replay_image
TEST_test_ordered_SOURCES := tests/apps/test_ordered.c apps/exr_channels.c apps/exr_file.c \
                             apps/exr_keep.c apps/imageio.c apps/imageio_exr.c apps/imageio_hdr.c \
                             apps/imageio_pfm.c apps/imageio_png.c apps/imageio_ppm.c apps/layers.c \
                             apps/ordered.c apps/platform.c apps/platform_threads.c
TEST_test_parts_SOURCES := tests/apps/test_parts.c apps/compare.c apps/exr_channels.c \
                           apps/exr_file.c apps/exr_keep.c apps/imageio.c apps/imageio_exr.c \
                           apps/imageio_hdr.c apps/imageio_pfm.c apps/imageio_png.c \
                           apps/imageio_ppm.c apps/json.c apps/layers.c apps/options.c \
                           apps/ordered.c apps/pattern.c apps/platform.c apps/platform_threads.c \
                           apps/report.c apps/sequence.c
TEST_replay_image_SOURCES := tests/fuzz/replay.c tests/fuzz/fuzz_image.c apps/exr_channels.c \
                             apps/exr_file.c apps/exr_keep.c apps/imageio.c apps/imageio_exr.c \
                             apps/imageio_hdr.c apps/imageio_pfm.c apps/imageio_png.c \
                             apps/imageio_ppm.c apps/layers.c apps/ordered.c apps/platform.c \
                             apps/platform_threads.c
