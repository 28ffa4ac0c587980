/* Reference: a sensor's model in double precision (<hadalens/sensor.h>), with the random numbers of the device.
 * Internal.
 */
#ifndef HADA_REF_SENSOR_H
#define HADA_REF_SENSOR_H

#include <hadalens/sensor.h>
#include <stddef.h>

/* What pixel number `index` (over all channels) makes of light; `gain` is its vignetting. */
double hada_ref_sensor(const hada_sensor *sensor, uint64_t seed, size_t index, double gain, double light);

/* Probability of at most `count` electrons at a mean (Poisson), by its sum. */
double hada_ref_poisson_below(double mean, int count);

/* The same of what the approximation for large means draws: the normal number that it turns into count + 1/2, by
 * bisection, and the share of normal numbers below. */
double hada_ref_poisson_approximated(double mean, int count);

#endif
