/* What lull has beyond the interface of Open Image Denoise: a device type of its own. Include it
 * after or in place of oidn.h; with Open Image Denoise itself, asking for this type is an error. */
#ifndef LULL_DEVICE_H
#define LULL_DEVICE_H

#include "oidn.h"

OIDN_API_NAMESPACE_BEGIN

/* For oidnNewDevice: OpenCL. A graphics processor if there is one that will do, else any device
 * that will; the environment variable LULL_OPENCL_DEVICE numbers one (from 0 on, over all
 * platforms). Integer networks, the built-in ones among them, give the same bytes as on the CPU;
 * those in floating point are refused by the filter's commit, with
 * OIDN_ERROR_UNSUPPORTED_HARDWARE. Images are ordinary memory.
 *
 * Errors: OIDN_ERROR_UNSUPPORTED_HARDWARE if there is no OpenCL library or no device that will do;
 * nothing else loads the library. The device's commit compiles the kernels.
 *
 * In C++, with oidn.hpp: static_cast<oidn::DeviceType>(LULL_DEVICE_TYPE_OPENCL). */
#define LULL_DEVICE_TYPE_OPENCL 1000

/* Name of the hardware of a device; valid as long as the device. NULL is an error of no device. */
OIDN_API const char *lull_device_name(OIDNDevice device);

OIDN_API_NAMESPACE_END

#endif
