/* The pixels of a tile, as lists for macros: X(number, base, offset) with the address of the
 * pixel's run written as base + offset. Bases are x, y = x + 3 * step, z = x + 6 * step and t =
 * x + 9 * step, so that every address fits an x86 operand. Tiles are made of named variables
 * because compilers keep arrays of accumulators in memory. */
#ifndef LULL_X86_PIXELS_H
#define LULL_X86_PIXELS_H

#define PIXELS_1(X) X(0, x, 0)
#define PIXELS_4(X) PIXELS_1(X) X(1, x, step) X(2, x, 2 * step) X(3, y, 0)
#define PIXELS_6(X) PIXELS_4(X) X(4, y, step) X(5, y, 2 * step)
#define PIXELS_5(X) PIXELS_4(X) X(4, y, step)
#define PIXELS_8(X) PIXELS_6(X) X(6, z, 0) X(7, z, step)
#define PIXELS_12(X) PIXELS_8(X) X(8, z, 2 * step) X(9, t, 0) X(10, t, step) X(11, t, 2 * step)

#define PIXELS_PASTE_(count) PIXELS_##count
#define PIXELS_PASTE(count) PIXELS_PASTE_(count)

#endif
