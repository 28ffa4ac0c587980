/* Hadalens: what a sensor makes of the light that falls on it.
 *
 * Per pixel, with light L (what a simulator renders) and random numbers that depend on seed and pixel alone:
 *
 *     m = exposure * v * max(L, 0)                vignetting v; m as a share of the full scale
 *     e = Poisson(m * full_well)                  electrons: shot noise; at most full_well where it saturates
 *     y = (e + read_noise * normal) / full_well + dark_level
 *     value = round(min(y, 1) * M) / M            M = 2^bits - 1, and at least 0
 *
 * Poisson numbers are exact below a mean of 16 (products of uniform numbers, Knuth), and from there on the rounded
 * Cornish-Fisher expansion of a normal number, whose distribution function is off by at most 1.3e-4 at 16, 1.5e-5 at
 * 64 and 3e-7 at 1000 electrons (docs/explanation/simulation.md). Random numbers: Philox4x32-10 (Salmon et al., SC
 * 2011), so frames do not depend on the order of the work.
 *
 * Threads: sensors are plain values. */
#ifndef HADALENS_SENSOR_H
#define HADALENS_SENSOR_H

#include <hadalens/image.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_vignetting {
    HADA_VIGNETTING_NONE = 0,
    HADA_VIGNETTING_COS4 =
        1, /* cos^4 of the angle at which the middle of the mask is seen, on the axis at its distance */
    HADA_VIGNETTING_IMAGE = 2 /* as given */
} hada_vignetting;

typedef struct hada_sensor {
    size_t size;       /* sizeof(hada_sensor) */
    double exposure;   /* share of the full scale that light of 1 makes; 1 by default */
    double full_well;  /* electrons at full scale, up to 1e6; 0 (default): light is not counted, no shot noise */
    double read_noise; /* standard deviation, in electrons; as a share of the full scale where full_well is 0 */
    double dark_level; /* what a dark pixel reads, as a share of the full scale */
    int saturate;      /* 1 (default): nothing above full_well, nor above full scale; 0: unbounded, with bits 0 only */
    int bits;          /* of the converter, 1 to 16; 0 (default): values are not rounded, and may be negative */
    hada_vignetting vignetting;
    const hada_image *gain; /* HADA_VIGNETTING_IMAGE: one channel of sensor size, 0 or more; not copied */
} hada_sensor;

/* An ideal sensor: everything off. */
HADA_INIT(hada_sensor, HADA_STRUCT_SENSOR)

/* HADA_ERROR_ARGUMENT with the value that is not possible. */
HADA_API hada_status hada_sensor_check(const hada_sensor *sensor, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
