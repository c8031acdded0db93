#include "lull.h"

const char *lull_status_text(lull_status status)
{
    static const char *const texts[LULL_STATUS_COUNT] = {
        "no error",
        "cancelled",
        "invalid argument",
        "not enough memory",
        "invalid or corrupted weights",
        "unsupported version of the weights file",
        "the weights are of no known network",
        "the weights do not match the input images",
        "missing or unsuitable image",
        "unsupported operation"
    };
    return (unsigned)status < LULL_STATUS_COUNT ? texts[status] : "unknown status";
}
