/* conform: every port that this CPU runs. Ports that it cannot run are skipped, with a reason.
 *
 *   conform                 the tests
 *   conform --row           also prints each port's row for docs/ports.md; the environment variable
 *                           LULL_CONFORM_WHERE names the emulator, if it is one
 *   conform --bench [port]  speed of each slot (bench.h)
 */
#include <stdio.h>
#include <stdlib.h>

#include "bench.h"
#include "conform.h"
#include "cpu.h"
#include "guard.h"

static const struct {
    const char *name;
    void (*fill)(lull_kernels *);
} ports[] = {
#define PORT(name) {#name, lull_port_##name},
#include "ports.def"
};

int main(int argc, char **argv)
{
    uint32_t available = (lull_cpu_request(), lull_cpu_ports());
    unsigned count = sizeof ports / sizeof ports[0];
    int rows = argc > 1 && strcmp(argv[1], "--row") == 0;
    if (argc > 1 && strcmp(argv[1], "--bench") == 0)
        return bench_main(argc > 2 ? argv[2] : NULL);
    if (!guard_init())
        printf("no guard pages on this system: stray accesses go unnoticed\n");
    for (unsigned i = 0; i < count; i++) {
        if (!(available >> i & 1)) {
            conform_skip(ports[i].name, "optional: this CPU lacks its instructions");
            continue;
        }
        conform_port(ports[i].name, ports[i].fill);
        if (rows)
            conform_row(ports[i].name, ports[i].fill, getenv("LULL_CONFORM_WHERE"));
    }
    return conform_report();
}
