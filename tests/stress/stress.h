/* Numerical stability under stress. Each group of conditions is a cmocka test that writes rows (condition, error,
 * bound) into one table; a row passes when its error is not above its bound, which tests/stress/bounds.md derives. */
#ifndef HADA_STRESS_H
#define HADA_STRESS_H

#include <float.h>

#include "runtime/buffer.h"
#include "testing.h"

/* Unit roundoff of single precision, and of half precision. */
#define STRESS_U    0x1p-24
#define STRESS_HALF 0x1p-11

/* tiny: for simulators that take seconds for what a processor does in microseconds; brief: what a test run can afford;
 * full: by hand, with large sizes and many rounds. */
typedef enum stress_form { STRESS_TINY = 0, STRESS_BRIEF = 1, STRESS_FULL = 2 } stress_form;
extern stress_form stress_form_now;

/* A row of the table; `rule` is the paragraph of tests/stress/bounds.md that gives the bound. An error that is NaN
 * fails. */
void stress_row(const char *rule, double error, double bound, const char *format, ...) HADA_PRINTF(4, 5);
/* A row for something that must not happen: passes when `count` is 0. */
void stress_none(const char *rule, size_t count, const char *format, ...) HADA_PRINTF(3, 4);

/* To be called at the end of a group: fails the test when one of its rows failed. */
void stress_end_group(void);

/* The groups. */
void stress_transforms(void **state);
void stress_sizes(void **state);
void stress_frames(void **state);
void stress_broken(void **state);
void stress_filters(void **state);
void stress_fit(void **state);
void stress_sums(void **state);
void stress_focus(void **state);
void stress_refinement(void **state);
void stress_convolutions(void **state);

/* A device of its own for a group. */
typedef struct stress_device {
    hada_context *context;
    hada_slot *slot;
    int denormals; /* the device computes with denormal numbers */
} stress_device;
stress_device stress_open(void);
void stress_close(stress_device *device);

/* Bounds (stress_bound.c). Relative L2 error of a transform of rows x cols, forward or inverse, of data without
 * structure (T1), and of any data (T2). */
double stress_fft_bound(int rows, int cols);
double stress_fft_worst(int rows, int cols);
/* What numbers near the smallest add to the L2 error of a transform, in units of the image's values (T3). */
double stress_fft_underflow(const stress_device *device, int rows, int cols);
/* Relative error of a sum of n positive numbers, one after the other (S1). */
double stress_sum_bound(double n);

/* Fills. */
void stress_fill_normal(float *to, size_t count, uint64_t seed);
void stress_fill_uniform(float *to, size_t count, uint64_t seed);
/* From 1 to 1e12, the logarithms uniform. */
void stress_fill_range(float *to, size_t count, uint64_t seed);
void *stress_memory(size_t count, size_t size); /* zeroed */

double stress_norm(const float *values, size_t count);
double stress_norm_double(const double *values, size_t count);
/* |got - want|, not relative. */
double stress_distance(const float *got, const double *want, size_t count);
size_t stress_not_finite(const float *values, size_t count);

#endif
