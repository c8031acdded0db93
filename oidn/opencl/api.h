/* The part of OpenCL 1.2 that the facade uses, in words of its own: names, numbers and signatures
 * are those of the specification. The functions are found in the installed library at run time. */
#ifndef LULL_OIDN_OPENCL_API_H
#define LULL_OIDN_OPENCL_API_H

#include <stddef.h>
#include <stdint.h>

#if defined(_WIN32)
#define LULL_CL_CALL __stdcall
#else
#define LULL_CL_CALL
#endif

typedef struct lull_cl_platform *cl_platform;
typedef struct lull_cl_device *cl_device;
typedef struct lull_cl_context *cl_context;
typedef struct lull_cl_queue *cl_queue;
typedef struct lull_cl_program *cl_program;
typedef struct lull_cl_kernel *cl_kernel;
typedef struct lull_cl_memory *cl_memory;

enum {
    CL_SUCCESS = 0,
    CL_MEM_OBJECT_ALLOCATION_FAILURE = -4,
    CL_OUT_OF_RESOURCES = -5,
    CL_OUT_OF_HOST_MEMORY = -6
};

/* Kinds of devices, and what is asked of one. */
#define CL_DEVICE_TYPE_GPU (UINT64_C(1) << 2)
#define CL_DEVICE_TYPE_ALL UINT64_C(0xffffffff)
enum {
    CL_DEVICE_TYPE = 0x1000,
    CL_DEVICE_MAX_WORK_GROUP_SIZE = 0x1004,
    CL_DEVICE_MAX_MEM_ALLOC_SIZE = 0x1010,
    CL_DEVICE_SINGLE_FP_CONFIG = 0x101b,
    CL_DEVICE_ENDIAN_LITTLE = 0x1026,
    CL_DEVICE_AVAILABLE = 0x1027,
    CL_DEVICE_COMPILER_AVAILABLE = 0x1028,
    CL_DEVICE_NAME = 0x102b,
    CL_DEVICE_PROFILE = 0x102e,
    CL_DEVICE_VERSION = 0x102f
};
#define CL_FP_DENORM (UINT64_C(1) << 0)
#define CL_FP_INF_NAN (UINT64_C(1) << 1)
#define CL_FP_ROUND_TO_NEAREST (UINT64_C(1) << 2)
#define CL_FP_CORRECTLY_ROUNDED_DIVIDE_SQRT (UINT64_C(1) << 7)

#define CL_MEM_READ_WRITE (UINT64_C(1) << 0)
#define CL_MEM_READ_ONLY (UINT64_C(1) << 2)
#define CL_MEM_COPY_HOST_PTR (UINT64_C(1) << 5)
#define CL_MAP_READ (UINT64_C(1) << 0)
#define CL_MAP_WRITE (UINT64_C(1) << 1)
#define CL_MAP_WRITE_INVALIDATE_REGION (UINT64_C(1) << 2)
enum { CL_PROGRAM_BUILD_LOG = 0x1183 };

/* FUNCTION(result, name, parameters): events, and functions that are called back, are left out as
 * const void *. */
#define LULL_CL_FUNCTIONS(FUNCTION)                                                                \
    FUNCTION(int32_t, clGetPlatformIDs, (uint32_t room, cl_platform * out, uint32_t * count))      \
    FUNCTION(int32_t, clGetDeviceIDs,                                                              \
             (cl_platform platform, uint64_t type, uint32_t room, cl_device *out,                  \
              uint32_t *count))                                                                    \
    FUNCTION(int32_t, clGetDeviceInfo,                                                             \
             (cl_device device, uint32_t what, size_t room, void *out, size_t *bytes))             \
    FUNCTION(cl_context, clCreateContext,                                                          \
             (const intptr_t *properties, uint32_t count, const cl_device *devices,                \
              const void *notify, void *user, int32_t *error))                                     \
    FUNCTION(int32_t, clReleaseContext, (cl_context context))                                      \
    FUNCTION(cl_queue, clCreateCommandQueue,                                                       \
             (cl_context context, cl_device device, uint64_t properties, int32_t *error))          \
    FUNCTION(int32_t, clReleaseCommandQueue, (cl_queue queue))                                     \
    FUNCTION(cl_program, clCreateProgramWithSource,                                                \
             (cl_context context, uint32_t count, const char **texts, const size_t *lengths,       \
              int32_t *error))                                                                     \
    FUNCTION(int32_t, clBuildProgram,                                                              \
             (cl_program program, uint32_t count, const cl_device *devices, const char *options,   \
              const void *notify, void *user))                                                     \
    FUNCTION(int32_t, clGetProgramBuildInfo,                                                       \
             (cl_program program, cl_device device, uint32_t what, size_t room, void *out,         \
              size_t *bytes))                                                                      \
    FUNCTION(int32_t, clReleaseProgram, (cl_program program))                                      \
    FUNCTION(cl_kernel, clCreateKernel, (cl_program program, const char *name, int32_t *error))    \
    FUNCTION(int32_t, clReleaseKernel, (cl_kernel kernel))                                         \
    FUNCTION(int32_t, clSetKernelArg,                                                              \
             (cl_kernel kernel, uint32_t index, size_t bytes, const void *value))                  \
    FUNCTION(cl_memory, clCreateBuffer,                                                            \
             (cl_context context, uint64_t flags, size_t bytes, void *host, int32_t *error))       \
    FUNCTION(int32_t, clReleaseMemObject, (cl_memory memory))                                      \
    FUNCTION(int32_t, clEnqueueNDRangeKernel,                                                      \
             (cl_queue queue, cl_kernel kernel, uint32_t dimensions, const size_t *offset,         \
              const size_t *global, const size_t *local, uint32_t waits, const void *wait_list,    \
              const void *event))                                                                  \
    FUNCTION(void *, clEnqueueMapBuffer,                                                           \
             (cl_queue queue, cl_memory memory, uint32_t blocks, uint64_t flags, size_t offset,    \
              size_t bytes, uint32_t waits, const void *wait_list, const void *event,              \
              int32_t *error))                                                                     \
    FUNCTION(int32_t, clEnqueueUnmapMemObject,                                                     \
             (cl_queue queue, cl_memory memory, void *mapped, uint32_t waits,                      \
              const void *wait_list, const void *event))                                           \
    FUNCTION(int32_t, clFinish, (cl_queue queue))

typedef struct lull_cl_api {
#define LULL_CL_MEMBER(result, name, parameters) result(LULL_CL_CALL *name) parameters;
    LULL_CL_FUNCTIONS(LULL_CL_MEMBER)
#undef LULL_CL_MEMBER
} lull_cl_api;

#endif
