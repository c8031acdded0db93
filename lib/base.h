/* Integers, attributes and small helpers shared by lib/ and ports/. The only place for compiler
 * extensions. */
#ifndef LULL_BASE_H
#define LULL_BASE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h> /* memcpy memmove memset memcmp: all that lib/ and ports/ use of libc */

#include "lull.h"

#if defined(__FAST_MATH__) || defined(_M_FP_FAST) || \
    (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__)
#error "lull needs IEEE arithmetic: compile it without -ffast-math (MSVC: without /fp:fast)"
#endif

#if defined(__GNUC__)
#define LULL_INLINE static inline __attribute__((always_inline, unused))
#define LULL_NOINLINE __attribute__((noinline)) /* its buffers shall not join the caller's */
#define LULL_RESTRICT __restrict__
#define LULL_ALIGNED(n) __attribute__((aligned(n)))
#define LULL_PREFETCH(p) __builtin_prefetch(p, 0, 2) /* for reading soon: into the L2 cache */
#else
#define LULL_INLINE static inline
#define LULL_NOINLINE
#define LULL_RESTRICT
#define LULL_ALIGNED(n)
#define LULL_PREFETCH(p) ((void)(p))
#endif

#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
#define LULL_BIG_ENDIAN 1
#else
#define LULL_BIG_ENDIAN 0
#endif

LULL_INLINE size_t lull_align_up(size_t n, size_t to) { return (n + to - 1) / to * to; }
/* Appends a block to a layout of *total bytes, aligned to LULL_ALIGN; returns its offset. */
LULL_INLINE size_t lull_append(size_t *total, size_t bytes)
{
    size_t at = *total;
    *total = at + lull_align_up(bytes, LULL_ALIGN);
    return at;
}

#define LULL_FLT_MAX 3.402823466e38f

LULL_INLINE unsigned lull_min_u(unsigned a, unsigned b) { return a < b ? a : b; }
LULL_INLINE unsigned lull_max_u(unsigned a, unsigned b) { return a > b ? a : b; }

/* Which ports this build contains (0 or 1 each; the build may define them, else all that the target
 * can have and that exist). The scalar port is always there. */
#if defined(__x86_64__) || defined(__i386__)
#define LULL_ARCH_X86 1
#else
#define LULL_ARCH_X86 0
#endif
#if defined(__aarch64__) && !LULL_BIG_ENDIAN
#define LULL_ARCH_ARM64 1
#else
#define LULL_ARCH_ARM64 0
#endif
#if defined(__arm__) && defined(__ARM_NEON) && !LULL_BIG_ENDIAN
#define LULL_ARCH_NEON32 1
#else
#define LULL_ARCH_NEON32 0
#endif
#ifndef LULL_WITH_SSE41
#define LULL_WITH_SSE41 LULL_ARCH_X86
#endif
#ifndef LULL_WITH_AVX2
#define LULL_WITH_AVX2 LULL_ARCH_X86
#endif
#ifndef LULL_WITH_AVX512
#define LULL_WITH_AVX512 LULL_ARCH_X86
#endif
#ifndef LULL_WITH_AVXVNNI
#define LULL_WITH_AVXVNNI LULL_ARCH_X86
#endif
#ifndef LULL_WITH_VNNI
#define LULL_WITH_VNNI LULL_ARCH_X86
#endif
#ifndef LULL_WITH_AMX
#define LULL_WITH_AMX LULL_ARCH_X86
#endif
#ifndef LULL_WITH_NEON
#define LULL_WITH_NEON (LULL_ARCH_ARM64 || LULL_ARCH_NEON32)
#endif
#ifndef LULL_WITH_DOTPROD
#define LULL_WITH_DOTPROD LULL_ARCH_ARM64
#endif
#ifndef LULL_WITH_I8MM
#define LULL_WITH_I8MM LULL_ARCH_ARM64
#endif
#ifndef LULL_WITH_SIMD128
#if defined(__wasm_simd128__)
#define LULL_WITH_SIMD128 1
#else
#define LULL_WITH_SIMD128 0
#endif
#endif

/* Bit pattern of a float and back. */
LULL_INLINE uint32_t lull_bits(float f)
{
    uint32_t u;
    memcpy(&u, &f, sizeof u);
    return u;
}

LULL_INLINE float lull_float(uint32_t u)
{
    float f;
    memcpy(&f, &u, sizeof f);
    return f;
}

/* 1 if f is a NaN, whatever floating-point options the compiler was given. */
LULL_INLINE int lull_is_nan(float f) { return (lull_bits(f) & 0x7fffffffu) > 0x7f800000u; }

/* Little-endian loads from any address. */
LULL_INLINE uint16_t lull_load_u16(const uint8_t *p) { return (uint16_t)(p[0] | p[1] << 8); }
LULL_INLINE uint32_t lull_load_u32(const uint8_t *p)
{
    return lull_load_u16(p) | (uint32_t)lull_load_u16(p + 2) << 16;
}
LULL_INLINE uint64_t lull_load_u64(const uint8_t *p)
{
    return lull_load_u32(p) | (uint64_t)lull_load_u32(p + 4) << 32;
}

#endif
