#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/patches_avx512.c"
#endif
