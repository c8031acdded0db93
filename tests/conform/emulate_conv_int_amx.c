#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/conv_int_amx.c"
#include "ports/x86/port_amx.c"
#endif
