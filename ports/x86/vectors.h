/* For the tile templates: B(...), C(...) and D(...) stand for their arguments if a tile has a
 * second, third and fourth vector, else for nothing. FOR_PIXELS(X) lists the pixels (pixels.h),
 * FOR_PAIRS(X) pairs of them. vectors_end.h undefines all, and TILE, VECTORS and PIXELS. */
#if VECTORS > 1
#define B(...) __VA_ARGS__
#else
#define B(...)
#endif
#if VECTORS > 2
#define C(...) __VA_ARGS__
#else
#define C(...)
#endif
#if VECTORS > 3
#define D(...) __VA_ARGS__
#else
#define D(...)
#endif
/* The products of a tile's n-th vector, of bytes. */
#if defined(IS_HALF)
#define DOT_VECTOR(n, sum, x, w)     \
    do {                             \
        if ((n) == VECTORS)          \
            DOT_HALF(sum, x, w);     \
        else                         \
            DOT_NARROW(sum, x, w);   \
    } while (0)
#else
#define DOT_VECTOR(n, sum, x, w) DOT_NARROW(sum, x, w)
#endif
#define FOR_PIXELS PIXELS_PASTE(PIXELS_, PIXELS)
#define FOR_PAIRS PIXELS_PASTE(PAIRS_, PIXELS)
