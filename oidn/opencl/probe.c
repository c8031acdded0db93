/* Asks a device for arithmetic whose bits are known: drivers may be wrong about what they say. */
#include "opencl.h"

#include "../../ports/opencl/probe.h"

#include <string.h>

enum { VALUES = 4 * LULL_CL_PROBES };

/* Values in [1, 2), the same at every call. */
static void fill(float *values)
{
    uint32_t state = 1;
    unsigned i;

    for (i = 0; i < VALUES; i++) {
        state = state * 1664525u + 1013904223u;
        values[i] = 1.0f + (float)(state >> 9) * (1.0f / 8388608.0f);
    }
}

/* Lets the device compute in the memory of `values`. */
static int32_t run(lull_opencl *cl, cl_kernel kernel, cl_memory memory, float *values)
{
    const lull_cl_api *api = &cl->api;
    const size_t items = LULL_CL_PROBES;
    int32_t error = api->clSetKernelArg(kernel, 0, sizeof memory, &memory);
    void *mapped;

    if (error == CL_SUCCESS)
        error = api->clEnqueueNDRangeKernel(cl->queue, kernel, 1, NULL, &items, NULL, 0, NULL,
                                            NULL);
    if (error != CL_SUCCESS)
        return error;
    mapped = api->clEnqueueMapBuffer(cl->queue, memory, 1, CL_MAP_READ, 0, VALUES * sizeof *values,
                                     0, NULL, NULL, &error);
    if (error != CL_SUCCESS)
        return error;
    memcpy(values, mapped, VALUES * sizeof *values);
    error = api->clEnqueueUnmapMemObject(cl->queue, memory, mapped, 0, NULL, NULL);
    return error == CL_SUCCESS ? api->clFinish(cl->queue) : error;
}

bool lull_cl_probe_device(lull_opencl *cl, lull_fault *fault)
{
    float values[VALUES], expected[VALUES];
    cl_kernel kernel;
    cl_memory memory = NULL;
    int32_t error;
    unsigned i;

    fill(values);
    memcpy(expected, values, sizeof expected);
    for (i = 0; i < VALUES; i += 4)
        lull_cl_probe(expected + i);
    kernel = cl->api.clCreateKernel(cl->program, "probe", &error);
    if (error == CL_SUCCESS)
        memory = cl->api.clCreateBuffer(cl->context, CL_MEM_READ_WRITE | CL_MEM_COPY_HOST_PTR,
                                        sizeof values, values, &error);
    if (error == CL_SUCCESS)
        error = run(cl, kernel, memory, values);
    if (memory)
        cl->api.clReleaseMemObject(memory);
    if (kernel)
        cl->api.clReleaseKernel(kernel);
    if (!lull_cl_check(fault, error, "probe"))
        return false;
    return !memcmp(values, expected, sizeof values) ||
           lull_fail(fault, OIDN_ERROR_UNSUPPORTED_HARDWARE,
                     "the OpenCL device %s does not round as it says: results would differ from "
                     "those of other devices",
                     cl->name);
}
