/* Parameters by name, driven by params.def, and environment variables. */
#include "internal.h"

#include <limits.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const lull_param params[] = {
#define PARAM(owner, kind, name, slot, initial, access)                                            \
    {LULL_##owner, LULL_##kind, name, lull_value_##slot, LULL_##access},
#define ALIAS(owner, kind, name, slot, access)                                                     \
    {LULL_##owner, LULL_##kind, name, lull_value_##slot, LULL_##access},
#include "params.def"
};

#define LULL_INITIAL_BOOL(x) .i = (x)
#define LULL_INITIAL_INT(x) .i = (x)
#define LULL_INITIAL_FLOAT(x) .f = (x)
#define LULL_INITIAL_IMAGE(x) .i = (x)
#define LULL_INITIAL_DATA(x) .i = (x)

static const lull_value initial[LULL_SLOTS] = {
#define PARAM(owner, kind, name, slot, value, access) {LULL_INITIAL_##kind(value)},
#include "params.def"
};

const lull_param *lull_param_find(enum lull_owner owner, const char *name)
{
    size_t i;

    for (i = 0; i < sizeof params / sizeof *params; i++)
        if ((params[i].owner & owner) && !strcmp(params[i].name, name))
            return &params[i];
    return NULL;
}

void lull_params_reset(lull_value values[LULL_SLOTS]) { memcpy(values, initial, sizeof initial); }

/* The parameter if it may be set through an accessor of that kind; else warns. */
static const lull_param *settable(enum lull_owner owner, const char *name, bool is_float,
                                  int verbose)
{
    const lull_param *param = lull_param_find(owner, name);
    const bool fits = param && (is_float ? param->kind == LULL_FLOAT
                                         : param->kind == LULL_BOOL || param->kind == LULL_INT);

    if (fits && param->access != LULL_GET)
        return param;
    lull_warn(verbose, "ignoring %s parameter '%s'", fits ? "read-only" : "unknown or mistyped",
              name);
    return NULL;
}

bool lull_param_set_int(lull_value values[], enum lull_owner owner, const char *name, int value,
                        int verbose, lull_fault *fault)
{
    const lull_param *param = settable(owner, name, false, verbose);

    if (!param)
        return true;
    if (param->access == LULL_QUALITY) {
        if (value == OIDN_QUALITY_DEFAULT)
            value = OIDN_QUALITY_HIGH;
        if (value != OIDN_QUALITY_FAST && value != OIDN_QUALITY_BALANCED &&
            value != OIDN_QUALITY_HIGH && value != LULL_QUALITY_AUTO)
            return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT, "unknown filter quality: %d",
                             value);
    }
    values[param->slot].i = param->kind == LULL_BOOL ? value != 0 : value;
    return true;
}

void lull_param_set_float(lull_value values[], enum lull_owner owner, const char *name, float value,
                          int verbose)
{
    const lull_param *param = settable(owner, name, true, verbose);

    if (param)
        values[param->slot].f = value;
}

bool lull_param_get(const lull_value values[], enum lull_owner owner, const char *name,
                    bool is_float, lull_value *value, lull_fault *fault)
{
    const lull_param *param = lull_param_find(owner, name);

    if (!param || (is_float ? param->kind != LULL_FLOAT
                            : param->kind != LULL_BOOL && param->kind != LULL_INT))
        return lull_fail(fault, OIDN_ERROR_INVALID_ARGUMENT,
                         "unknown %s parameter or type mismatch: '%.80s'",
                         owner == LULL_DEVICE ? "device" : "filter", name);
    *value = values[param->slot];
    return true;
}

/* ---- Environment and messages ---------------------------------------------------------------- */

int lull_env_is_set(const char *name) { return getenv(name) != NULL; }

int lull_env_int(const char *name, int otherwise)
{
    long value;

    if (!lull_env_is_set(name))
        return otherwise;
    value = strtol(getenv(name), NULL, 10);
    return value > INT_MAX ? INT_MAX : value < INT_MIN ? INT_MIN : (int)value;
}

void lull_warn(int verbose, const char *format, ...)
{
    va_list args;

    if (verbose < 1)
        return;
    va_start(args, format);
    fputs("Warning: ", stderr);
    vfprintf(stderr, format, args);
    fputc('\n', stderr);
    va_end(args);
}
