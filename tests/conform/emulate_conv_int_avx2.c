#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/conv_int_avx2.c"
#include "ports/x86/pool_avx2.c"
#endif
