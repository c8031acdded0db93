/* The x86 intrinsics as portable functions (SIMDe), so that ports run on CPUs that lack their
 * instructions. The emulate_*.c files include a port's source after this header. Without SIMDe
 * (Debian: libsimde-dev), or on a big-endian CPU, EMULATE_X86 is 0 and they are empty. */
#ifndef LULL_TESTS_EMULATE_H
#define LULL_TESTS_EMULATE_H

#if defined(__has_include)
#if __has_include(<simde/x86/avx512.h>) && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__
#define EMULATE_X86 1
#endif
#endif
#ifndef EMULATE_X86
#define EMULATE_X86 0
#endif

/* All x86 ports exist here, whatever the build contains. */
#undef LULL_WITH_AVX2
#undef LULL_WITH_AVX512
#undef LULL_WITH_AVXVNNI
#undef LULL_WITH_VNNI
#define LULL_WITH_AVX2 1
#define LULL_WITH_AVX512 1
#define LULL_WITH_AVXVNNI 1
#define LULL_WITH_VNNI 1
#undef LULL_WITH_AMX
#define LULL_WITH_AMX 1

/* Names of their own: the library may hold the real ports. */
#define lull_port_avx2 emulated_port_avx2
#define lull_port_avx512 emulated_port_avx512
#define lull_port_avxvnni emulated_port_avxvnni
#define lull_port_vnni emulated_port_vnni
#define lull_conv_f32_avx2 emulated_conv_f32_avx2
#define lull_conv_int_avx2 emulated_conv_int_avx2
#define lull_conv_int3_avx2 emulated_conv_int3_avx2
#define lull_head_avx2 emulated_head_avx2
#define lull_winograd_in_avx2 emulated_winograd_in_avx2
#define lull_winograd_out_avx2 emulated_winograd_out_avx2
#define lull_patches_in_avx2 emulated_patches_in_avx2
#define lull_points_int_avx2 emulated_points_int_avx2
#define lull_patches_out_avx2 emulated_patches_out_avx2
#define lull_pool_f32_avx2 emulated_pool_f32_avx2
#define lull_pool_u8_avx2 emulated_pool_u8_avx2
#define lull_filter5_avx2 emulated_filter5_avx2
#define lull_encode_avx2 emulated_encode_avx2
#define lull_spread_avx2 emulated_spread_avx2
#define lull_spread_xyz_avx2 emulated_spread_xyz_avx2
#define lull_guide_avx2 emulated_guide_avx2
#define lull_demodulate_avx2 emulated_demodulate_avx2
#define lull_shrink_avx2 emulated_shrink_avx2
#define lull_blend_avx2 emulated_blend_avx2
#define lull_noise_avx2 emulated_noise_avx2
#define lull_bilateral_avx2 emulated_bilateral_avx2
#define lull_fit_sums_avx2 emulated_fit_sums_avx2
#define lull_fit_avx2 emulated_fit_avx2
#define lull_regress_avx2 emulated_regress_avx2
#define lull_residual_avx2 emulated_residual_avx2
#define lull_edges_avx2 emulated_edges_avx2
#define lull_grain_sums_avx2 emulated_grain_sums_avx2
#define lull_take_grain_avx2 emulated_take_grain_avx2
#define lull_modulate_avx2 emulated_modulate_avx2
#define lull_luminance_avx2 emulated_luminance_avx2
#define lull_conv_f32_avx512 emulated_conv_f32_avx512
#define lull_conv_int_avx512 emulated_conv_int_avx512
#define lull_conv_int3_avx512 emulated_conv_int3_avx512
#define lull_winograd_in_avx512 emulated_winograd_in_avx512
#define lull_winograd_out_avx512 emulated_winograd_out_avx512
#define lull_patches_in_avx512 emulated_patches_in_avx512
#define lull_points_int_avx512 emulated_points_int_avx512
#define lull_patches_out_avx512 emulated_patches_out_avx512
#define lull_points_int_avxvnni emulated_points_int_avxvnni
#define lull_points_int_vnni emulated_points_int_vnni
#define lull_conv_int_avxvnni emulated_conv_int_avxvnni
#define lull_conv_int3_avxvnni emulated_conv_int3_avxvnni
#define lull_conv_int_vnni emulated_conv_int_vnni
#define lull_conv_int_vnni_halves emulated_conv_int_vnni_halves
#define lull_conv_int3_vnni emulated_conv_int3_vnni
#define lull_port_amx emulated_port_amx
#define lull_conv_int_amx emulated_conv_int_amx

#if EMULATE_X86

#define LULL_EMULATE 1
#define SIMDE_ENABLE_NATIVE_ALIASES
#define SIMDE_NO_INLINE /* in place, the operations make these files take minutes to compile */
#include <simde/x86/avx512.h>
#include <simde/x86/fma.h>

#include <math.h>
#include <stdint.h>
#include <string.h>

/* SIMDe has some of what follows under these names since 0.8, masks of other types among them. */
#define __mmask16 simde__mmask16
#define __mmask32 simde__mmask32
#define __mmask64 simde__mmask64

/* SIMDe 0.8.4 leaves these out where the compiler has those that SSE knows (gcc 16). */
#ifndef _CMP_ORD_Q
#define _CMP_ORD_Q SIMDE_CMP_ORD_Q
#endif
#ifndef _CMP_GT_OQ
#define _CMP_GT_OQ SIMDE_CMP_GT_OQ
#endif

/* SIMDe 0.7.4 defines this name with four parameters. */
#undef _mm512_madd_epi16
#define _mm512_madd_epi16(a, b) simde_mm512_madd_epi16(a, b)

/* Intrinsics that SIMDe lacks, or lacked before 0.8, from their definitions. */

static inline void emulate_store(void *to, const void *from, uint64_t mask, unsigned lanes,
                                 unsigned bytes)
{
    for (unsigned i = 0; i < lanes; i++)
        if (mask >> i & 1)
            memcpy((char *)to + i * bytes, (const char *)from + i * bytes, bytes);
}

#undef _mm512_mask_storeu_epi8
#define _mm512_mask_storeu_epi8(to, mask, v)            \
    do {                                                \
        simde__m512i emulate_v = (v);                   \
        emulate_store((to), &emulate_v, (mask), 64, 1); \
    } while (0)
#undef _mm256_mask_storeu_epi8
#define _mm256_mask_storeu_epi8(to, mask, v)            \
    do {                                                \
        simde__m256i emulate_v = (v);                   \
        emulate_store((to), &emulate_v, (mask), 32, 1); \
    } while (0)
#undef _mm_mask_storeu_epi8
#define _mm_mask_storeu_epi8(to, mask, v)               \
    do {                                                \
        simde__m128i emulate_v = (v);                   \
        emulate_store((to), &emulate_v, (mask), 16, 1); \
    } while (0)
#undef _mm512_mask_storeu_epi16
#define _mm512_mask_storeu_epi16(to, mask, v)           \
    do {                                                \
        simde__m512i emulate_v = (v);                   \
        emulate_store((to), &emulate_v, (mask), 32, 2); \
    } while (0)
#undef _mm512_mask_storeu_ps
#define _mm512_mask_storeu_ps(to, mask, v)              \
    do {                                                \
        simde__m512 emulate_v = (v);                    \
        emulate_store((to), &emulate_v, (mask), 16, 4); \
    } while (0)

static inline simde__m512 emulate_load(uint64_t mask, const float *from)
{
    simde__m512 v = simde_mm512_setzero_ps();
    emulate_store(&v, from, mask, 16, 4);
    return v;
}
#undef _mm512_maskz_loadu_ps
#define _mm512_maskz_loadu_ps(mask, from) emulate_load(mask, from)

/* SIMDe 0.7.4 reads the lanes that are masked out. */
static inline simde__m256 emulate_maskload(const float *from, simde__m256i mask)
{
    float lane[8] = {0};
    int32_t wanted[8];
    simde__m256 v;
    memcpy(wanted, &mask, sizeof wanted);
    for (unsigned i = 0; i < 8; i++)
        if (wanted[i] < 0)
            lane[i] = from[i];
    memcpy(&v, lane, sizeof v);
    return v;
}
#undef _mm256_maskload_ps
#define _mm256_maskload_ps(from, mask) emulate_maskload(from, mask)

static inline simde__m512i emulate_sra(simde__m512i a, simde__m128i count)
{
    int32_t lane[16], n[4];
    memcpy(lane, &a, sizeof lane);
    memcpy(n, &count, sizeof n);
    for (unsigned i = 0; i < 16; i++)
        lane[i] = lane[i] < 0 ? ~(~lane[i] >> n[0]) : lane[i] >> n[0];
    memcpy(&a, lane, sizeof lane);
    return a;
}
#undef _mm512_sra_epi32
#define _mm512_sra_epi32(a, count) emulate_sra(a, count)

static inline simde__m512i emulate_shuffle(simde__m512i from, unsigned mask, simde__m512i a,
                                           unsigned order)
{
    int32_t lane[16], out[16];
    memcpy(lane, &a, sizeof lane);
    memcpy(out, &from, sizeof out);
    for (unsigned i = 0; i < 16; i++)
        if (mask >> i & 1)
            out[i] = lane[(i & ~3u) + (order >> 2 * (i & 3) & 3)];
    memcpy(&a, out, sizeof out);
    return a;
}
#undef _mm512_mask_shuffle_epi32
#define _mm512_mask_shuffle_epi32(from, mask, a, order) emulate_shuffle(from, mask, a, order)
#define _MM_PERM_DDBB 0xf5

static inline simde__m512 emulate_to_floats(simde__m512i a)
{
    simde__m512 v;
    int32_t from[16];
    float to[16];
    memcpy(from, &a, sizeof from);
    for (unsigned i = 0; i < 16; i++)
        to[i] = (float)from[i];
    memcpy(&v, to, sizeof v);
    return v;
}
#undef _mm512_cvtepi32_ps
#define _mm512_cvtepi32_ps(a) emulate_to_floats(a)

static inline simde__m512i emulate_to_ints(simde__m512 a)
{
    simde__m512i v;
    float from[16];
    int32_t to[16];
    memcpy(from, &a, sizeof from);
    for (unsigned i = 0; i < 16; i++)
        to[i] = from[i] >= -0x1p31f && from[i] < 0x1p31f ? (int32_t)from[i] : INT32_MIN;
    memcpy(&v, to, sizeof v);
    return v;
}
#undef _mm512_cvttps_epi32
#define _mm512_cvttps_epi32(a) emulate_to_ints(a)

/* a * b + c, rounded once, down. The product of two floats is a double; `rest` is what the double
 * that is nearest to the sum lacks. */
static inline float emulate_fma_down(float a, float b, float c)
{
    volatile double product = (double)a * b, sum = product + c, part = sum - product;
    volatile double rest = product - (sum - part), more = c - part;
    float f = (float)sum;
    rest += more;
    if ((double)f > sum || ((double)f == sum && rest < 0))
        f = nextafterf(f, -INFINITY);
    return f;
}

/* The same of each lane of vectors, into a. */
static inline void emulate_fma_lanes(void *a, const void *b, const void *c, unsigned lanes)
{
    float x[16], y[16], z[16];
    memcpy(x, a, lanes * sizeof *x);
    memcpy(y, b, lanes * sizeof *y);
    memcpy(z, c, lanes * sizeof *z);
    for (unsigned i = 0; i < lanes; i++)
        x[i] = emulate_fma_down(x[i], y[i], z[i]);
    memcpy(a, x, lanes * sizeof *x);
}

static inline simde__m512 emulate_fma_512(simde__m512 a, simde__m512 b, simde__m512 c)
{
    emulate_fma_lanes(&a, &b, &c, 16);
    return a;
}
#undef _mm512_fmadd_round_ps
#define _mm512_fmadd_round_ps(a, b, c, how) emulate_fma_512(a, b, c) /* always down */

/* The register that holds how 256 bits are rounded: to the nearest, or by fused products down. */
static inline unsigned *emulate_csr(void)
{
    static unsigned csr = 0x1f80;
    return &csr;
}
#undef _mm_getcsr
#undef _mm_setcsr
#undef _MM_ROUND_MASK
#undef _MM_ROUND_DOWN
#undef _MM_MASK_MASK
#define _mm_getcsr() (*emulate_csr())
#define _mm_setcsr(value) (void)(*emulate_csr() = (value))
#define _MM_ROUND_MASK 0x6000
#define _MM_ROUND_DOWN 0x2000
#define _MM_MASK_MASK 0x1f80

static inline simde__m256 emulate_fma_256(simde__m256 a, simde__m256 b, simde__m256 c)
{
    if (!(*emulate_csr() & _MM_ROUND_DOWN))
        return simde_mm256_fmadd_ps(a, b, c);
    emulate_fma_lanes(&a, &b, &c, 8);
    return a;
}
#undef _mm256_fmadd_ps
#define _mm256_fmadd_ps(a, b, c) emulate_fma_256(a, b, c)

/* AVX-VNNI: the operations of AVX512-VNNI on 256 bits. */
#undef _mm256_dpbusd_avx_epi32
#define _mm256_dpbusd_avx_epi32(sum, x, w) simde_mm256_dpbusd_epi32(sum, x, w)
#undef _mm256_dpwssd_avx_epi32
#define _mm256_dpwssd_avx_epi32(sum, x, w) simde_mm256_dpwssd_epi32(sum, x, w)

#include "emulate_tiles.h"
#endif
#endif
