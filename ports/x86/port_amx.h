#ifndef LULL_PORT_AMX_H
#define LULL_PORT_AMX_H

#include "port_vnni.h" /* which every CPU with tiles has */

#if !LULL_EMULATE && (!defined(__AVX512BW__) || !defined(__AVX512VL__))
#error "this file is compiled with -mamx-tile -mamx-int8 and AVX-512"
#endif

/* Tiles exist in 64-bit programs only, and only Linux is asked to let a program use them. */
#if LULL_EMULATE || (defined(__x86_64__) && defined(__linux__))
#define LULL_HAS_TILES 1
#else
#define LULL_HAS_TILES 0
#endif

void lull_conv_int_amx(const lull_conv *conv);

#endif
