/* The sensor's model on the device. Internal. */
#ifndef HADA_OPTICS_EXPOSE_H
#define HADA_OPTICS_EXPOSE_H

#include <hadalens/sensor.h>

#include "runtime/slot.h"

/* Enqueues what the sensor makes of `count` values, channels of `pixels` each, in place (from `offset` floats on).
 * `gain` holds `pixels` values; NULL: no vignetting. */
hada_status hada_optics_expose(hada_slot *slot, cl_mem values, size_t offset, cl_mem gain, size_t pixels, size_t count,
                               const hada_sensor *sensor, uint64_t seed, hada_error *err);

#endif
