/* The time that passes. Internal. */
#ifndef HADA_CORE_CLOCK_H
#define HADA_CORE_CLOCK_H

/* Seconds since some moment in the past; never goes back. */
double hada_seconds(void);

#endif
