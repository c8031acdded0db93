# The OIDN facade. Makefile, meson.build, CMakeLists.txt read this: plain assignments only, paths from the top
# of the tree.
OIDN_SOURCES := oidn/auto.c oidn/buffer.c oidn/builtin.c oidn/commit.c oidn/cpus.c oidn/device.c oidn/ensemble.c \
                oidn/error.c oidn/execute.c oidn/filter.c oidn/image_param.c oidn/legacy.c oidn/os.c \
                oidn/lightmap.c oidn/panorama.c oidn/params.c oidn/physical.c oidn/queue.c oidn/semaphore.c oidn/threads.c
# OpenCL devices: the host's part, and the texts that the program for the device is made of, one after
# the other. OPENCL=0 leaves both out.
OPENCL_SOURCES := oidn/opencl/device.c oidn/opencl/plan.c oidn/opencl/probe.c \
                  oidn/opencl/schedule.c
OPENCL_TEXTS := ports/opencl/prelude.cl lib/pixels.h ports/opencl/args.h ports/opencl/tensors.cl \
                ports/opencl/conv.cl ports/opencl/input.cl ports/opencl/filter.cl \
                ports/opencl/result.cl ports/opencl/probe.h ports/opencl/probe.cl
