/* lull: a filter quality beside those of OIDNQuality.
 *
 *     #include <OpenImageDenoise/lull_quality.h>
 *
 *     oidnSetFilterInt(filter, "quality", LULL_QUALITY_AUTO);
 *     ...
 *     oidnExecuteFilter(filter);
 *     taken = oidnGetFilterInt(filter, "usedQuality"); // OIDN_QUALITY_FAST, _BALANCED or _HIGH
 *
 * At each execution the built-in models denoise a sample of the frame, and the smallest one whose
 * result looks like that of high quality denoises the frame: the output has the bytes of the
 * quality that was taken. Which one that is depends on the pixels and on nothing else. There is no
 * sample, and it is OIDN_QUALITY_HIGH, for small frames, for filters with weights of their own and
 * those of OpenCL devices, and where maxMemoryMB is 0 or leaves no room for all the models and the
 * sample, of which each thread looks at a part in memory of its own.
 *
 * "usedQuality" is of all filters and read only: the quality of the latest execution that was
 * completed, OIDN_QUALITY_DEFAULT before there is one. Open Image Denoise knows neither name: it
 * answers both with an error. */
#ifndef LULL_QUALITY_H
#define LULL_QUALITY_H

#define LULL_QUALITY_AUTO 100

#endif
