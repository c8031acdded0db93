/* Version, build configuration and helper macros of the Open Image Denoise interface that lull
 * implements. Macros that a build may set before this file: OIDN_API_NAMESPACE (see namespace.h),
 * OIDN_STATIC_LIB (linking the static library on Windows), OIDN_LEGACY_1X (see oidn.h). */
#ifndef OIDN_CONFIG_H
#define OIDN_CONFIG_H

/* Level of the interface, not the version of lull (that is in lull.h). */
#define OIDN_VERSION_MAJOR 2
#define OIDN_VERSION_MINOR 5
#define OIDN_VERSION_PATCH 1
#define OIDN_VERSION 20501 /* 10000 major + 100 minor + patch */
#define OIDN_VERSION_STRING "2.5.1"
#define OIDN_VERSION_STRING_SHORT "2.5.1"

/* What this library contains: the CPU device and both filters. */
#ifndef OIDN_DEVICE_CPU
#define OIDN_DEVICE_CPU
#endif
#ifndef OIDN_FILTER_RT
#define OIDN_FILTER_RT
#endif
#ifndef OIDN_FILTER_RTLIGHTMAP
#define OIDN_FILTER_RTLIGHTMAP
#endif

#if defined(__cplusplus)
#define OIDN_API_EXTERN_C extern "C"
#else
#define OIDN_API_EXTERN_C
#endif

#define OIDN_MACRO_JOIN_(a, b) a##b
#define OIDN_MACRO_JOIN(a, b) OIDN_MACRO_JOIN_(a, b)

#if defined(OIDN_API_NAMESPACE)
#include "namespace.h"
#define OIDN_NAMESPACE_C OIDN_MACRO_JOIN(OIDN_API_NAMESPACE, _oidn)
#define OIDN_NAMESPACE OIDN_API_NAMESPACE::oidn
#else
#define OIDN_NAMESPACE_C oidn
#define OIDN_NAMESPACE oidn
#endif

#if defined(OIDN_API_NAMESPACE) && defined(__cplusplus)
#define OIDN_API_NAMESPACE_BEGIN namespace OIDN_API_NAMESPACE {
#define OIDN_API_NAMESPACE_END }
#define OIDN_API_NAMESPACE_USING using namespace OIDN_API_NAMESPACE;
#else
#define OIDN_API_NAMESPACE_BEGIN
#define OIDN_API_NAMESPACE_END
#define OIDN_API_NAMESPACE_USING
#endif

/* Scope of the C++ interface (oidn.hpp). */
#define OIDN_NAMESPACE_BEGIN OIDN_API_NAMESPACE_BEGIN namespace oidn {
#define OIDN_NAMESPACE_END } OIDN_API_NAMESPACE_END
#define OIDN_NAMESPACE_USING using namespace OIDN_NAMESPACE;

/* Linkage of an exported function. The build of the library defines OpenImageDenoise_EXPORTS. */
#if defined(OIDN_STATIC_LIB) || !(defined(_WIN32) || defined(__GNUC__))
#define OIDN_API_IMPORT OIDN_API_EXTERN_C
#define OIDN_API_EXPORT OIDN_API_EXTERN_C
#elif defined(_WIN32)
#define OIDN_API_IMPORT OIDN_API_EXTERN_C __declspec(dllimport)
#define OIDN_API_EXPORT OIDN_API_EXTERN_C __declspec(dllexport)
#else
#define OIDN_API_IMPORT OIDN_API_EXTERN_C
#define OIDN_API_EXPORT OIDN_API_EXTERN_C __attribute__((visibility("default")))
#endif

#if defined(OpenImageDenoise_EXPORTS)
#define OIDN_API OIDN_API_EXPORT
#else
#define OIDN_API OIDN_API_IMPORT
#endif

#if defined(_MSC_VER)
#define OIDN_DEPRECATED(msg) __declspec(deprecated(msg))
#elif defined(__GNUC__)
#define OIDN_DEPRECATED(msg) __attribute__((deprecated(msg)))
#else
#define OIDN_DEPRECATED(msg)
#endif

/* Convenience functions are inline in callers, so that a program built with these headers needs
 * nothing that another implementation of the interface might lack. The library exports them too,
 * for programs that look them up by name. */
#if defined(OpenImageDenoise_EXPORTS)
#define OIDN_INLINE OIDN_API
#define OIDN_INLINE_BODY(...) ;
#elif defined(__cplusplus)
#define OIDN_INLINE inline
#define OIDN_INLINE_BODY(...) { __VA_ARGS__ }
#else
#define OIDN_INLINE static inline
#define OIDN_INLINE_BODY(...) { __VA_ARGS__ }
#endif

#endif
