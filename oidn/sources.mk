# The OIDN facade. Makefile and meson.build read this file: plain assignments only, paths from the top
# of the tree.
OIDN_SOURCES := oidn/auto.c oidn/buffer.c oidn/builtin.c oidn/commit.c oidn/cpus.c oidn/device.c oidn/error.c \
                oidn/execute.c oidn/filter.c oidn/image_param.c oidn/legacy.c oidn/os.c \
                oidn/params.c oidn/physical.c oidn/queue.c oidn/semaphore.c oidn/threads.c
