#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/conv_f32_avx512.c"
#include "ports/x86/port_avx512.c"
#endif
