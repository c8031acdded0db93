#undef B
#undef C
#undef D
#undef FOR_PIXELS
#undef FOR_PAIRS
#undef TILE
#undef VECTORS
#undef PIXELS
