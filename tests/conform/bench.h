/* Speed of the kernels of this CPU. */
#ifndef LULL_TESTS_BENCH_H
#define LULL_TESTS_BENCH_H

/* Prints, for each port (or the named one) and each slot that it fills, multiply-accumulates
 * per second over a row of each layer shape (points_int: at all points of a few patches), and the
 * share of the peak of the instructions that the port uses, measured in the same run; of slots
 * without products nanoseconds for each pixel. Thread CPU time; median of several runs. Returns
 * the exit status. */
int bench_main(const char *port);

/* Peaks: multiply-accumulates per second of register-only loops of the instructions of a port's
 * convolutions; 0 where they are not known. */
typedef struct bench_peak {
    const char *port;
    const char *slot; /* conv_f32, conv_int or points_int; or `in words`: of conv_int, sums that fit
                       * words, where a port has a way of its own for them */
    const char *instructions;
    double (*macs)(unsigned rounds); /* runs the loop; multiply-accumulates done */
} bench_peak;

extern const bench_peak bench_peaks[];
extern const unsigned bench_peak_count;

#endif
