/* Whether a device computes as it says: arithmetic that gives other bits where products and sums
 * are contracted or quotients rounded in another way, in what C99 and OpenCL C have in common. */
#ifndef LULL_OPENCL_PROBE_H
#define LULL_OPENCL_PROBE_H

#ifndef __OPENCL_VERSION__
#include "pixels.h"
#endif

#define LULL_CL_PROBES 256u

/* Four values, x, y in [1, 2) and two others, to what comes of them. */
LULL_INLINE void lull_cl_probe(float *v)
{
    float x = v[0], y = v[1], product = x * y, share[3];
    share[0] = x;
    share[1] = y;
    share[2] = v[2];
    lull_shares(share, 1.0f, y);
    v[0] = x * y - product; /* 0, unless it is contracted */
    v[1] = x / y;
    v[2] = lull_log_code(1.0f + LULL_LOG_GAIN * (x * v[3]));
    v[3] = share[0] + share[1] * share[2];
}

#endif
