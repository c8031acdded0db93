/* Stands at the top of lull.c, the core in one file (amalgamate.py): what the Makefile's flags are
 * for, said in the file itself, whatever flags it is compiled with. */
#ifndef LULL_AMALGAMATION_H
#define LULL_AMALGAMATION_H

/* No fused multiply-adds but those that the source asks for: results are the same on every CPU. */
#if defined(__clang__)
#pragma STDC FP_CONTRACT OFF
#elif defined(__GNUC__)
#pragma GCC push_options
#pragma GCC optimize("fp-contract=off")
#elif defined(_MSC_VER)
#pragma fp_contract(off)
#endif

/* All but the interface is static, whether a port uses it or not; local names are those of other
 * files' functions; and gcc does not follow everywhere what is inlined from one file into another's
 * functions. Some of it is found out at the end: this stays. */
#if defined(__GNUC__)
#pragma GCC diagnostic ignored "-Wunused-function"
#pragma GCC diagnostic ignored "-Wshadow"
#if !defined(__clang__)
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
#endif

/* Ports are compiled for their instructions function by function. Which of them a compiler knows
 * shows in its headers, or in its version where these lack functions of instructions that the whole
 * file may not use. Other compilers than gcc and clang get the scalar port alone. */
#if !defined(__GNUC__) || defined(_MSC_VER) || !defined(__has_include)
#define LULL_WITH_SSE41 0
#define LULL_WITH_AVX2 0
#define LULL_WITH_AVX512 0
#define LULL_WITH_AVXVNNI 0
#define LULL_WITH_VNNI 0
#define LULL_WITH_AMX 0
#define LULL_WITH_NEON 0
#define LULL_WITH_DOTPROD 0
#define LULL_WITH_I8MM 0
#elif defined(__x86_64__) || defined(__i386__)
/* Zig forbids registers of 512 bits where nobody asks for them. */
#if defined(__clang__) && __clang_major__ >= 18 && __clang_major__ < 22
#define LULL_AVX512 ",evex512"
#else
#define LULL_AVX512
#endif
#if !__has_include(<avxvnniintrin.h>)
#define LULL_WITH_AVXVNNI 0
#endif
#if !__has_include(<avx512vnniintrin.h>)
#define LULL_WITH_VNNI 0
#endif
#if !__has_include(<amxint8intrin.h>)
#define LULL_WITH_AMX 0
#endif
#elif defined(__aarch64__)
/* gcc replaces the architecture: what the file has beside it would be inlined where it is not. */
#if !defined(__ARM_FEATURE_DOTPROD) && \
    (defined(__clang__) ? __clang_major__ < 16 : __GNUC__ < 8 || defined(__ARM_FEATURE_CRYPTO) || \
     defined(__ARM_FEATURE_AES) || defined(__ARM_FEATURE_FP16_SCALAR_ARITHMETIC) || \
     defined(__ARM_FEATURE_SVE) || defined(__ARM_FEATURE_COMPLEX))
#define LULL_WITH_DOTPROD 0
#define LULL_WITH_I8MM 0
#elif !defined(__ARM_FEATURE_MATMUL_INT8) && \
    (defined(__clang__) ? __clang_major__ < 16 : __GNUC__ < 10)
#define LULL_WITH_I8MM 0
#endif
#elif defined(__arm__) && !defined(__clang__) && defined(__ARM_FP) && __ARM_ARCH >= 7 && \
    defined(__ARMEL__)
#define LULL_WITH_NEON 1
#endif

#endif
