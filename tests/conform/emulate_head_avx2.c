#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/head_avx2.c"
#endif
