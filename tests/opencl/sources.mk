# C test programs of this folder. They want an OpenCL device: pocl's will do (tests/setup.sh).
TESTS += test_opencl_frames
TEST_test_opencl_frames_SOURCES := tests/opencl/frames.c tests/api/identity.c
TESTS += test_opencl_device
TEST_test_opencl_device_SOURCES := tests/opencl/device.c tests/api/identity.c
