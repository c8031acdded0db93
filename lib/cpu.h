/* What the CPU can run. */
#ifndef LULL_CPU_H
#define LULL_CPU_H

#include "base.h"

/* Mask of the ports (bits in the order of ports.def) whose instructions this CPU and its operating
 * system support. ARM's optional extensions are known to the operating system alone: Linux is asked
 * where a C library is linked; elsewhere they count as supported when the compiler was allowed to
 * use them everywhere. */
uint32_t lull_cpu_ports(void);

/* 1: the CPU's vector units add while others of them multiply (AMD's; x86 of other makers adds in
 * the units that multiply). There points cost less than the products that they save (patches.h),
 * also beside VNNI. Has no influence on results. */
unsigned lull_cpu_adds_beside(void);

/* 1: vectors of 256 bits take half the time of those of 512 bits, which the CPU does in two passes
 * (Zen 4). Has no influence on results. */
unsigned lull_cpu_halves_pay(void);

/* lull_ports_request. */
void lull_cpu_request(void);

#endif
