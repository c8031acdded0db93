/* The list word_shapes of integer tiles of runs that fit words, where the port has DOT_WORDS (see
 * conv_int_tile.h), else another name of small_shapes. A sum has two registers at the end of a run
 * alone; within it none is needed for ones, nor for the sums of runs before. */
#if defined(DOT_WORDS)
#undef IS_WORDS
#undef TILE_2
#undef TILE_1
#define IS_WORDS 1
#define TILE_2 6
#define TILE_1 12
#define TEMPLATE "conv_int_tile.h"
#define SHAPES word_shapes
#define SHAPE(vectors) words_##vectors
#include "shapes_256.h"
#else
#define word_shapes small_shapes
#endif
