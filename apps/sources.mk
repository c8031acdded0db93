# The programs. Makefile, meson.build, CMakeLists.txt read this: plain assignments only, paths from the top of
# the tree.
APPS := oidnDenoise oidnBenchmark lullInfo yimgdenoise ynlmdenoise
APP_COMMON_SOURCES := apps/device.c apps/exr_channels.c apps/exr_file.c apps/exr_keep.c \
                      apps/imageio.c apps/imageio_exr.c apps/imageio_hdr.c apps/imageio_pfm.c \
                      apps/imageio_png.c apps/imageio_ppm.c apps/json.c apps/layers.c \
                      apps/options.c apps/ordered.c apps/platform.c apps/platform_threads.c \
                      apps/report.c
APP_oidnDenoise_SOURCES := apps/oidnDenoise.c apps/compare.c apps/denoise_check.c apps/denoise_frame.c \
                           apps/denoise_inputs.c apps/denoise_options.c apps/denoise_outputs.c \
                           apps/denoise_passes.c apps/denoise_run.c apps/denoise_split.c \
                           apps/doctor.c apps/doctor_maps.c apps/sequence.c apps/temporal.c
APP_oidnBenchmark_SOURCES := apps/oidnBenchmark.c apps/pattern.c
APP_lullInfo_SOURCES := apps/lullInfo.c apps/compare.c
APP_yimgdenoise_SOURCES := apps/yimgdenoise.c apps/compare.c apps/denoise_check.c apps/denoise_frame.c \
                           apps/denoise_inputs.c apps/denoise_options.c apps/denoise_outputs.c \
                           apps/denoise_passes.c apps/denoise_run.c apps/denoise_split.c \
                           apps/doctor.c apps/doctor_maps.c apps/sequence.c apps/temporal.c
APP_ynlmdenoise_SOURCES := apps/ynlmdenoise.c apps/compare.c
# The module for JavaScript (make wasm); what the one with threads has beside it.
APP_WEB_SOURCES := apps/web/module.c
APP_WEB_THREADS_SOURCES := apps/web/pool.c
