#include "emulate.h"
#if EMULATE_X86
#include "ports/x86/conv_points_vnni.c"
#endif
