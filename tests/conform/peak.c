/* Loops of the ports' multiply instructions on registers alone: what a CPU could do at best. */
#include <stddef.h>
#include <stdint.h>

#include "bench.h"

#if defined(__x86_64__) && defined(__GNUC__)

#define EIGHT(X) X(0) X(1) X(2) X(3) X(4) X(5) X(6) X(7)
#define TWELVE(X) EIGHT(X) X(8) X(9) X(10) X(11)
#define TWENTY_FOUR(X) \
    TWELVE(X) X(12) X(13) X(14) X(15) X(16) X(17) X(18) X(19) X(20) X(21) X(22) X(23)

/* `accumulators` independent sums in registers 0 on; zeroes them and the operands 24 to 28 (or,
 * in 256 bits, 12 to 15). Each step is `macs` multiply-accumulates. */
#define LOOP(name, accumulators, count, clear, body, macs)                                        \
    static double name(unsigned rounds)                                                           \
    {                                                                                             \
        unsigned n = rounds;                                                                      \
        __asm__ volatile(clear "1:\n" accumulators(body) "dec %0\njnz 1b\nvzeroupper\n"           \
                         : "+r"(n)                                                                \
                         :                                                                        \
                         : "xmm0", "xmm1", "xmm2", "xmm3", "xmm4", "xmm5", "xmm6", "xmm7", "xmm8", \
                           "xmm9", "xmm10", "xmm11", "xmm12", "xmm13", "xmm14", "xmm15", "cc");   \
        return (double)rounds * (count) * (macs);                                                 \
    }

#define CLEAR_256(i) "vpxor %%xmm" #i ",%%xmm" #i ",%%xmm" #i "\n"
#define FMA_256(i) "vfmadd231ps %%ymm13,%%ymm14,%%ymm" #i "\n"
#define INT8_256(i)                        \
    "vpmaddubsw %%ymm14,%%ymm15,%%ymm12\n" \
    "vpmaddwd %%ymm13,%%ymm12,%%ymm12\n"   \
    "vpaddd %%ymm12,%%ymm" #i ",%%ymm" #i "\n"
#define ADD_WORDS_256(i)                   \
    "vpmaddubsw %%ymm14,%%ymm15,%%ymm12\n" \
    "vpaddw %%ymm12,%%ymm" #i ",%%ymm" #i "\n"
#define VNNI_256(i) "%{vex%} vpdpbusd %%ymm13,%%ymm14,%%ymm" #i "\n"
#define WORDS_256(i)                     \
    "vpmaddwd %%ymm13,%%ymm14,%%ymm12\n" \
    "vpaddd %%ymm12,%%ymm" #i ",%%ymm" #i "\n"
#define VNNI_WORDS_256(i) "%{vex%} vpdpwssd %%ymm13,%%ymm14,%%ymm" #i "\n"
#define ALL_CLEAR_256 TWELVE(CLEAR_256) CLEAR_256(12) CLEAR_256(13) CLEAR_256(14) CLEAR_256(15)

#define CLEAR_512(i) "vpxord %%zmm" #i ",%%zmm" #i ",%%zmm" #i "\n"
#define FMA_512(i) "vfmadd231ps %%zmm25,%%zmm26,%%zmm" #i "\n"
#define INT8_512(i)                        \
    "vpmaddubsw %%zmm26,%%zmm27,%%zmm24\n" \
    "vpmaddwd %%zmm25,%%zmm24,%%zmm24\n"   \
    "vpaddd %%zmm24,%%zmm" #i ",%%zmm" #i "\n"
#define ADD_WORDS_512(i)                   \
    "vpmaddubsw %%zmm26,%%zmm27,%%zmm24\n" \
    "vpaddw %%zmm24,%%zmm" #i ",%%zmm" #i "\n"
#define VNNI_512(i) "vpdpbusd %%zmm25,%%zmm26,%%zmm" #i "\n"
#define WORDS_512(i)                     \
    "vpmaddwd %%zmm25,%%zmm26,%%zmm24\n" \
    "vpaddd %%zmm24,%%zmm" #i ",%%zmm" #i "\n"
#define VNNI_WORDS_512(i) "vpdpwssd %%zmm25,%%zmm26,%%zmm" #i "\n"
#define ALL_CLEAR_512 \
    TWENTY_FOUR(CLEAR_512) CLEAR_512(24) CLEAR_512(25) CLEAR_512(26) CLEAR_512(27)

LOOP(fma_256, TWELVE, 12, ALL_CLEAR_256, FMA_256, 8)
LOOP(int8_256, TWELVE, 12, ALL_CLEAR_256, INT8_256, 32)
LOOP(add_words_256, TWELVE, 12, ALL_CLEAR_256, ADD_WORDS_256, 32)
LOOP(vnni_256, TWELVE, 12, ALL_CLEAR_256, VNNI_256, 32)
LOOP(fma_512, TWENTY_FOUR, 24, ALL_CLEAR_512, FMA_512, 16)
LOOP(int8_512, TWENTY_FOUR, 24, ALL_CLEAR_512, INT8_512, 64)
LOOP(add_words_512, TWENTY_FOUR, 24, ALL_CLEAR_512, ADD_WORDS_512, 64)
LOOP(vnni_512, TWENTY_FOUR, 24, ALL_CLEAR_512, VNNI_512, 64)
LOOP(words_256, TWELVE, 12, ALL_CLEAR_256, WORDS_256, 16)
LOOP(vnni_words_256, TWELVE, 12, ALL_CLEAR_256, VNNI_WORDS_256, 16)
LOOP(words_512, TWENTY_FOUR, 24, ALL_CLEAR_512, WORDS_512, 32)
LOOP(vnni_words_512, TWENTY_FOUR, 24, ALL_CLEAR_512, VNNI_WORDS_512, 32)

/* Whole tiles, 16 rows of 64 bytes: six of sums, 6 by 7. A product takes as long as some sixty of
 * the vectors above: fewer rounds. */
static double tiles(unsigned rounds)
{
    struct {
        uint8_t palette, start, reserved[14];
        uint16_t bytes[16]; /* of a row */
        uint8_t rows[16];
    } config = {1, 0, {0}, {64, 64, 64, 64, 64, 64, 64, 64}, {16, 16, 16, 16, 16, 16, 16, 16}};
    unsigned n = rounds / 16, all = n;
#define CLEAR_TILE(i) "tilezero %%tmm" #i "\n"
#define TILE(i) "tdpbusd %%tmm7,%%tmm6,%%tmm" #i "\n"
    __asm__ volatile("ldtilecfg %1\n" EIGHT(CLEAR_TILE) "1:\n" TILE(0) TILE(1) TILE(2) TILE(3)
                         TILE(4) TILE(5) "dec %0\njnz 1b\ntilerelease\n"
                     : "+r"(n)
                     : "m"(config)
                     : "cc");
    return (double)all * 6 * 16 * 16 * 64;
}

const bench_peak bench_peaks[] = {
    {"avx2", "conv_f32", "vfmadd231ps ymm", fma_256},
    {"avx2", "conv_int", "vpmaddubsw vpmaddwd vpaddd ymm", int8_256},
    {"avx512", "conv_f32", "vfmadd231ps zmm", fma_512},
    {"avx512", "conv_int", "vpmaddubsw vpmaddwd vpaddd zmm", int8_512},
    {"avx2", "in words", "vpmaddubsw vpaddw ymm", add_words_256},
    {"avx512", "in words", "vpmaddubsw vpaddw zmm", add_words_512},
    {"avxvnni", "conv_int", "vpdpbusd ymm", vnni_256},
    {"vnni", "conv_int", "vpdpbusd zmm", vnni_512},
    {"amx", "conv_int", "tdpbusd tmm", tiles},
    {"avx2", "points_int", "vpmaddwd vpaddd ymm", words_256},
    {"avx512", "points_int", "vpmaddwd vpaddd zmm", words_512},
    {"avxvnni", "points_int", "vpdpwssd ymm", vnni_words_256},
    {"vnni", "points_int", "vpdpwssd zmm", vnni_words_512},
};
const unsigned bench_peak_count = sizeof bench_peaks / sizeof bench_peaks[0];

#elif defined(__aarch64__) && defined(__GNUC__)

#define SIXTEEN(X) \
    X(0) X(1) X(2) X(3) X(4) X(5) X(6) X(7) X(16) X(17) X(18) X(19) X(20) X(21) X(22) X(23)

#define LOOP(name, body, macs)                                                                   \
    static double name(unsigned rounds)                                                          \
    {                                                                                            \
        unsigned n = rounds;                                                                     \
        __asm__ volatile(".arch armv8.2-a+dotprod+i8mm\n1:\n" SIXTEEN(body)                      \
                         "subs %w0, %w0, #1\nb.ne 1b\n"                                          \
                         : "+r"(n)                                                               \
                         :                                                                       \
                         : "v0", "v1", "v2", "v3", "v4", "v5", "v6", "v7", "v16", "v17", "v18",  \
                           "v19", "v20", "v21", "v22", "v23", "v24", "v25", "v26", "v27", "cc"); \
        return (double)rounds * 16 * (macs);                                                     \
    }

#define FMLA(i) "fmla v" #i ".4s, v24.4s, v25.4s\n"
#define INT8(i)                      \
    "smull v27.8h, v24.8b, v25.8b\n" \
    "smlal v27.8h, v26.8b, v25.8b\n" \
    "sadalp v" #i ".4s, v27.8h\n"
#define SDOT(i) "sdot v" #i ".4s, v24.16b, v25.4b[0]\n"
#define USMMLA(i) "usmmla v" #i ".4s, v24.16b, v25.16b\n"

LOOP(fmla, FMLA, 4)
LOOP(int8, INT8, 16)
LOOP(sdot, SDOT, 16)
LOOP(usmmla, USMMLA, 32)

const bench_peak bench_peaks[] = {
    {"neon", "conv_f32", "fmla 4s", fmla},
    {"neon", "conv_int", "smull smlal sadalp", int8},
    {"dotprod", "conv_int", "sdot", sdot},
    {"i8mm", "conv_int", "usmmla", usmmla},
};
const unsigned bench_peak_count = sizeof bench_peaks / sizeof bench_peaks[0];

#else
const bench_peak bench_peaks[] = {{NULL, NULL, NULL, NULL}};
const unsigned bench_peak_count = 0;
#endif
