#include "cpu.h"
#include "kernels.h"

static const char *const port_names[] = {
#define PORT(name) #name,
#include "ports.def"
};

static void (*const port_fillers[])(lull_kernels *) = {
#define PORT(name) lull_port_##name,
#include "ports.def"
};

static const char *const slot_names[] = {
#define KERNEL(name, parameters, tolerance, purpose) #name,
#include "kernels.def"
};

#define SLOT_COUNT (sizeof slot_names / sizeof slot_names[0])
#define PORT_COUNT (sizeof port_names / sizeof port_names[0])

uint32_t lull_ports_available(void) { return lull_cpu_ports(); }

void lull_ports_request(void) { lull_cpu_request(); }

const char *lull_port_name(unsigned index)
{
    return index < PORT_COUNT ? port_names[index] : NULL;
}

uint32_t lull_ports_up_to(const char *name, size_t length)
{
    for (unsigned i = 0; i < PORT_COUNT; i++) {
        const char *known = port_names[i];
        size_t n = 0;
        while (n < length && known[n] && known[n] == name[n])
            n++;
        if (n == length && !known[n])
            return (2u << i) - 1;
    }
    return 0;
}

void lull_kernels_fill(lull_kernels *kernels, uint32_t ports)
{
    memset(kernels, 0, sizeof *kernels);
    kernels->adds_beside = lull_cpu_adds_beside();
    kernels->halves_pay = lull_cpu_halves_pay();
    ports = (ports & lull_cpu_ports()) | LULL_PORTS_SCALAR;
    for (unsigned i = 0; i < PORT_COUNT; i++)
        if (ports >> i & 1)
            port_fillers[i](kernels);
}

const char *lull_kernel_name(unsigned index)
{
    return index < SLOT_COUNT ? slot_names[index] : NULL;
}

unsigned lull_kernel_port(unsigned index, uint32_t ports)
{
    lull_kernels strongest, upto;
    unsigned i = 0;
    lull_kernels_fill(&strongest, ports);
    do {
        unsigned n = 0, same = 0;
        lull_kernels_fill(&upto, ports & ((2u << i) - 1));
#define KERNEL(name, parameters, tolerance, purpose) \
    same |= n++ == index && upto.name == strongest.name;
#include "kernels.def"
        if (same)
            return i;
    } while (++i < PORT_COUNT);
    return 0;
}
