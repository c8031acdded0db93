#include "cpu.h"

/* Instruction set features, as needed by the rows below. */
enum {
    FEATURE_NONE = 0,
    FEATURE_AVX2 = 1,       /* AVX2, FMA, and an OS that saves the ymm registers */
    FEATURE_AVX512 = 2,     /* AVX-512 F, BW, VL, DQ, and an OS that saves zmm and mask registers */
    FEATURE_AVXVNNI = 4,    /* AVX-VNNI */
    FEATURE_AVX512VNNI = 8, /* AVX-512 VNNI */
    FEATURE_NEON = 16,
    FEATURE_DOTPROD = 32,
    FEATURE_I8MM = 64,
    FEATURE_AMX = 128, /* AMX-TILE, AMX-INT8, and an OS that lets this process use tiles */
    FEATURE_SSE41 = 256, /* SSE4.1 and SSSE3 */
    FEATURE_SIMD128 = 512 /* WebAssembly's vectors: who lacks them refuses the whole module */
};

#if !LULL_ARCH_X86 || !defined(__GNUC__)
/* Features that the compiler was allowed to use everywhere. */
static uint32_t compiled_features(void)
{
    uint32_t found = 0;
#if defined(__ARM_NEON)
    found |= FEATURE_NEON;
#endif
#if defined(__ARM_FEATURE_DOTPROD)
    found |= FEATURE_DOTPROD;
#endif
#if defined(__ARM_FEATURE_MATMUL_INT8)
    found |= FEATURE_I8MM;
#endif
#if LULL_WITH_SIMD128
    found |= FEATURE_SIMD128;
#endif
    return found;
}
#endif

#if LULL_ARCH_X86 && defined(__GNUC__)
#include <cpuid.h>

#if defined(__linux__) && defined(__x86_64__)
/* Linux keeps the tile registers back until a process asks for them. Without a C library there is
 * only the instruction itself. */
enum { ARCH_PRCTL = 158, GET_PERMISSION = 0x1022, REQUEST_PERMISSION = 0x1023, TILE_DATA = 18 };

static long arch_prctl(long code, void *argument)
{
    long result;
    __asm__ volatile("syscall"
                     : "=a"(result)
                     : "0"((long)ARCH_PRCTL), "D"(code), "S"(argument)
                     : "rcx", "r11", "memory");
    return result;
}

static int may_use_tiles(void)
{
    uint64_t components = 0;
    return arch_prctl(GET_PERMISSION, &components) == 0 && (components >> TILE_DATA & 1);
}
#else
static int may_use_tiles(void) { return 0; }
#endif

static int has_amx(uint32_t xcr0, uint32_t d7)
{
    return (xcr0 & 0x60000) == 0x60000 && (d7 >> 24 & 1) && (d7 >> 25 & 1);
}

static uint32_t features(void)
{
    uint32_t a, b, c, d, b7, c7, d7, found = 0, xcr0, hi;
    (void)d;
    if (!__get_cpuid(1, &a, &b, &c, &d))
        return 0;
    if ((c & bit_SSSE3) && (c & bit_SSE4_1))
        found |= FEATURE_SSE41;
    if (!(c & bit_OSXSAVE) || !(c & bit_AVX))
        return found;
    __asm__("xgetbv" : "=a"(xcr0), "=d"(hi) : "c"(0));
    if ((xcr0 & 6) != 6 || !__get_cpuid_count(7, 0, &a, &b7, &c7, &d7))
        return found;
    if ((b7 & bit_AVX2) && (c & bit_FMA))
        found |= FEATURE_AVX2;
    if ((found & FEATURE_AVX2) && __get_cpuid_count(7, 1, &a, &b, &c, &d) && (a & (1u << 4)))
        found |= FEATURE_AVXVNNI;
    if ((xcr0 & 0xe6) == 0xe6 && (b7 & bit_AVX512F) && (b7 & bit_AVX512BW) &&
        (b7 & bit_AVX512VL) && (b7 & bit_AVX512DQ)) {
        found |= FEATURE_AVX512;
        if (c7 & (1u << 11))
            found |= FEATURE_AVX512VNNI;
        if (has_amx(xcr0, d7) && may_use_tiles())
            found |= FEATURE_AMX;
    }
    return found;
}
#elif defined(__linux__) && defined(__GNUC__) && (defined(__aarch64__) || defined(__arm__))
/* Only the operating system knows. Weak: without a C library there is none to ask. */
extern unsigned long getauxval(unsigned long type) __attribute__((weak));

static uint32_t features(void)
{
    unsigned long caps = getauxval ? getauxval(16) : 0;  /* AT_HWCAP */
    unsigned long caps2 = getauxval ? getauxval(26) : 0; /* AT_HWCAP2 */
    uint32_t found = compiled_features();
#if defined(__aarch64__)
    found |= FEATURE_NEON;
    if (caps >> 20 & 1) /* HWCAP_ASIMDDP */
        found |= FEATURE_DOTPROD;
    if (caps2 >> 13 & 1) /* HWCAP2_I8MM */
        found |= FEATURE_I8MM;
#else
    (void)caps2;
    if (caps >> 12 & 1) /* HWCAP_NEON */
        found |= FEATURE_NEON;
#endif
    return found;
}
#else
static uint32_t features(void) { return compiled_features(); }
#endif

/* Features each port needs; a name without an entry would not compile. */
enum {
    NEEDS_scalar = FEATURE_NONE,
    NEEDS_sse41 = FEATURE_SSE41,
    NEEDS_avx2 = FEATURE_AVX2,
    NEEDS_avx512 = FEATURE_AVX512,
    NEEDS_avxvnni = FEATURE_AVX2 | FEATURE_AVXVNNI,
    NEEDS_vnni = FEATURE_AVX512 | FEATURE_AVX512VNNI,
    NEEDS_amx = FEATURE_AVX512 | FEATURE_AVX512VNNI | FEATURE_AMX,
    NEEDS_neon = FEATURE_NEON,
    NEEDS_dotprod = FEATURE_NEON | FEATURE_DOTPROD,
    NEEDS_i8mm = FEATURE_NEON | FEATURE_I8MM,
    NEEDS_simd128 = FEATURE_SIMD128
};

uint32_t lull_cpu_ports(void)
{
    static const uint32_t needs[] = {
#define PORT(name) NEEDS_##name,
#include "ports.def"
    };
    uint32_t found = features(), ports = 0;
    for (unsigned i = 0; i < sizeof needs / sizeof needs[0]; i++)
        if ((needs[i] & found) == needs[i])
            ports |= 1u << i;
    return ports;
}

unsigned lull_cpu_adds_beside(void)
{
#if LULL_ARCH_X86 && defined(__GNUC__)
    uint32_t a = 0, b = 0, c = 0, d = 0; /* set: gcc 12 at -O1 warns otherwise */
    return __get_cpuid(0, &a, &b, &c, &d) && b == signature_AMD_ebx && c == signature_AMD_ecx &&
           d == signature_AMD_edx;
#else
    return 0;
#endif
}

unsigned lull_cpu_halves_pay(void)
{
#if LULL_ARCH_X86 && defined(__GNUC__)
    enum { ZEN_3_AND_4 = 0x19 }; /* of these only Zen 4 has vectors of 512 bits */
    uint32_t a = 0, b = 0, c = 0, d = 0;
    return lull_cpu_adds_beside() && __get_cpuid(1, &a, &b, &c, &d) &&
           (a >> 8 & 15) + (a >> 20 & 255) == ZEN_3_AND_4;
#else
    return 0;
#endif
}

void lull_cpu_request(void)
{
#if LULL_ARCH_X86 && defined(__GNUC__) && defined(__linux__) && defined(__x86_64__)
    uint32_t a, b, c, d;
    if (__get_cpuid_count(7, 0, &a, &b, &c, &d) && (d >> 24 & 1))
        (void)arch_prctl(REQUEST_PERMISSION, (void *)(uintptr_t)TILE_DATA); /* it may be refused */
#endif
}
