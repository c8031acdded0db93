/* conform_emulated: the x86 ports on any CPU, their instructions emulated by SIMDe.
 *
 *   conform_emulated [--row]    --row also prints each port's row for docs/ports.md */
#include <string.h>

#include "emulate.h"
#include "conform.h"
#include "guard.h"

static const char *const names[] = {"avx2", "avx512", "avxvnni", "vnni", "amx"};

int main(int argc, char **argv)
{
    int rows = argc > 1 && strcmp(argv[1], "--row") == 0;
#if EMULATE_X86
    static void (*const fill[])(lull_kernels *) = {
        lull_port_avx2, lull_port_avx512, lull_port_avxvnni, lull_port_vnni, lull_port_amx};
    guard_init();
    for (unsigned i = 0; i < sizeof names / sizeof names[0]; i++) {
        conform_port(names[i], fill[i]);
        if (rows)
            conform_row(names[i], fill[i], "emulated (SIMDe)");
    }
#else
    (void)rows;
    for (unsigned i = 0; i < sizeof names / sizeof names[0]; i++)
        conform_skip(names[i],
                     "optional: needs SIMDe (Debian: libsimde-dev), a little-endian CPU");
#endif
    return conform_report();
}
