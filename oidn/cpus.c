/* Which processors to use, and what they are called. See os.h. */
#if !defined(_GNU_SOURCE)
#define _GNU_SOURCE /* sched_getaffinity */
#endif
#include "os.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if !defined(_WIN32)
#include <sched.h>
#include <unistd.h>
#endif

#if defined(__linux__) && defined(CPU_SET)

/* The first line of a small file, or 0. */
static int read_line(const char *path, char *line, int size)
{
    FILE *f = fopen(path, "r");
    int ok;

    if (!f)
        return 0;
    ok = fgets(line, size, f) != NULL;
    fclose(f);
    return ok;
}

/* Lowest logical CPU of `set` that shares a core with `cpu`. The list looks like "0,4" or "0-1". */
static int first_sibling(int cpu, const cpu_set_t *set)
{
    char path[96], list[256];
    char *p = list;

    snprintf(path, sizeof path, "/sys/devices/system/cpu/cpu%d/topology/thread_siblings_list", cpu);
    if (!read_line(path, list, sizeof list))
        return cpu;
    while (*p >= '0' && *p <= '9') {
        long first = strtol(p, &p, 10), last = first;

        if (*p == '-')
            last = strtol(p + 1, &p, 10);
        for (; first <= last && first < CPU_SETSIZE; first++)
            if (CPU_ISSET((int)first, set))
                return (int)first;
        if (*p == ',')
            p++;
    }
    return cpu;
}

/* CPUs that the container's quota is worth, rounded up, or 0 for no quota. */
static unsigned quota(void)
{
    char line[64];
    double share, period = 0;

    if (read_line("/sys/fs/cgroup/cpu.max", line, sizeof line)) {
        if (sscanf(line, "%lf %lf", &share, &period) != 2)
            return 0;
    } else if (read_line("/sys/fs/cgroup/cpu/cpu.cfs_quota_us", line, sizeof line)) {
        share = atof(line);
        if (read_line("/sys/fs/cgroup/cpu/cpu.cfs_period_us", line, sizeof line))
            period = atof(line);
    } else {
        return 0;
    }
    if (!(share > 0) || !(period > 0) || share / period > LULL_OS_MAX_CPUS)
        return 0;
    return (unsigned)((share + period - 1) / period);
}

void lull_cpus_detect(lull_cpus *cpus)
{
    cpu_set_t set;
    unsigned limit = quota();
    int cpu;

    memset(cpus, 0, sizeof *cpus);
    if (sched_getaffinity(0, sizeof set, &set) != 0) { /* forbidden, or more than CPU_SETSIZE */
        long online = sysconf(_SC_NPROCESSORS_ONLN);
        CPU_ZERO(&set);
        CPU_SET(0, &set);
        for (cpu = 1; cpu < online && cpu < CPU_SETSIZE; cpu++)
            CPU_SET(cpu, &set);
    }
    for (cpu = 0; cpu < CPU_SETSIZE && cpus->listed < LULL_OS_MAX_CPUS; cpu++) {
        if (!CPU_ISSET(cpu, &set))
            continue;
        cpus->available++;
        if (first_sibling(cpu, &set) == cpu)
            cpus->cpu[cpus->listed++] = (short)cpu;
    }
    cpus->count = cpus->listed ? cpus->listed : 1;
    if (limit && cpus->count > limit)
        cpus->count = limit;
    if (!cpus->available)
        cpus->available = 1;
}

#else

void lull_cpus_detect(lull_cpus *cpus)
{
    long n = 1;

    memset(cpus, 0, sizeof *cpus);
#if defined(_WIN32) && LULL_WITH_THREADS
    {
        SYSTEM_INFO info;

        GetSystemInfo(&info);
        n = (long)info.dwNumberOfProcessors;
    }
#elif defined(_SC_NPROCESSORS_ONLN)
    n = sysconf(_SC_NPROCESSORS_ONLN);
#endif
    cpus->available = n < 1 ? 1 : n > LULL_OS_MAX_CPUS ? LULL_OS_MAX_CPUS : (unsigned)n;
    cpus->count = cpus->available;
}

#endif

/* ---- Brand ----------------------------------------------------------------------------------- */

#if defined(__x86_64__) || defined(__i386__)
#include <cpuid.h>

static int read_brand(char text[49])
{
    unsigned r[12], i;

    if ((unsigned)__get_cpuid_max(0x80000000u, NULL) < 0x80000004u)
        return 0;
    for (i = 0; i < 3; i++)
        if (!__get_cpuid(0x80000002u + i, &r[4 * i], &r[4 * i + 1], &r[4 * i + 2], &r[4 * i + 3]))
            return 0;
    memcpy(text, r, 48);
    text[48] = 0;
    return 1;
}
#else
static int read_brand(char text[49])
{
    char line[128];
    char *p = NULL;
    FILE *f = fopen("/proc/cpuinfo", "r");

    if (!f)
        return 0;
    while (!p && fgets(line, sizeof line, f))
        if (!strncmp(line, "model name", 10) || !strncmp(line, "Hardware", 8))
            p = strchr(line, ':');
    fclose(f);
    if (!p)
        return 0;
    p[strcspn(p, "\r\n")] = 0;
    snprintf(text, 49, "%.48s", p + 1);
    return 1;
}
#endif

/* Copies without leading, trailing and repeated blanks. */
void lull_cpu_brand(char *text, size_t size)
{
    char brand[49];
    size_t n = 0;
    const char *p;

    if (!read_brand(brand))
        brand[0] = 0;
    for (p = brand; *p && n + 1 < size; p++)
        if (*p != ' ' || (n && text[n - 1] != ' '))
            text[n++] = *p;
    while (n && text[n - 1] == ' ')
        n--;
    text[n] = 0;
    if (!n)
        snprintf(text, size, "CPU");
}
