#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/conv_int_short_amx.c"
#endif
