#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/patches_avx2.c"
#endif
