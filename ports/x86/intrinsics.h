/* The intrinsics of the x86 ports. Tests run the ports on CPUs that lack them: they define
 * LULL_EMULATE as 1 and include portable functions of the same names before the port's source. */
#ifndef LULL_X86_INTRINSICS_H
#define LULL_X86_INTRINSICS_H

#ifndef LULL_EMULATE
#define LULL_EMULATE 0
#endif
#if !LULL_EMULATE
#include <immintrin.h>
#endif

/* Assembly statements stand in for intrinsics that compilers are known to spill around. */
#if defined(__GNUC__) && !LULL_EMULATE
#define LULL_X86_ASM 1
#else
#define LULL_X86_ASM 0
#endif

/* Keeps a vector in one register: without it some compilers copy sums around loops. */
#if LULL_X86_ASM
#define LULL_X86_KEEP(v) __asm__("" : "+x"(v))
#else
#define LULL_X86_KEEP(v) (void)0
#endif

#endif
