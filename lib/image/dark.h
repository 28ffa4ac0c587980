/* The dark level of a frame, from the frame itself. Internal. */
#ifndef HADA_IMAGE_DARK_H
#define HADA_IMAGE_DARK_H

#include <stddef.h>

/* The first percentile of `count` pixels (the value that 1 % lie below): a few dead pixels don't pull it down, and
 * light that covers less than 99 % of a frame doesn't lift it. `room` holds count floats. */
double hada_dark_estimate(const float *pixels, size_t count, float *room);

#endif
