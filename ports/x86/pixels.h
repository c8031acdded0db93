/* The pixels of a tile, as lists for macros: X(number, base, offset) with the address of the
 * pixel's run written as base + offset. Bases are x, y = x + 3 * step, z = x + 6 * step and t =
 * x + 9 * step, so that every address fits an x86 operand. Tiles are made of named variables
 * because compilers keep arrays of accumulators in memory. */
#ifndef LULL_X86_PIXELS_H
#define LULL_X86_PIXELS_H

#define PIXELS_1(X) X(0, x, 0)
#define PIXELS_3(X) PIXELS_1(X) X(1, x, step) X(2, x, 2 * step)
#define PIXELS_4(X) PIXELS_3(X) X(3, y, 0)
#define PIXELS_6(X) PIXELS_4(X) X(4, y, step) X(5, y, 2 * step)
#define PIXELS_8(X) PIXELS_6(X) X(6, z, 0) X(7, z, step)
#define PIXELS_12(X) PIXELS_8(X) X(8, z, 2 * step) X(9, t, 0) X(10, t, step) X(11, t, 2 * step)
/* Numbers alone matter to those who use this. */
#define PIXELS_24(X)                                                                            \
    PIXELS_12(X) X(12, , ) X(13, , ) X(14, , ) X(15, , ) X(16, , ) X(17, , ) X(18, , ) X(19, , ) \
    X(20, , ) X(21, , ) X(22, , ) X(23, , )

/* X(number, next number); a lone pixel is its own partner. */
#define PAIRS_1(X) X(0, 0)
#define PAIRS_4(X) X(0, 1) X(2, 3)
#define PAIRS_6(X) PAIRS_4(X) X(4, 5)
#define PAIRS_8(X) PAIRS_6(X) X(6, 7)
#define PAIRS_12(X) PAIRS_8(X) X(8, 9) X(10, 11)

#define PIXELS_PASTE_(list, count) list##count
#define PIXELS_PASTE(list, count) PIXELS_PASTE_(list, count)

#endif
