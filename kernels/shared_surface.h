/* What the kernels of surfaces and the host agree on. */
#ifndef SHARED_SURFACE_H
#define SHARED_SURFACE_H

#include "shared_types.h"

enum {
    HADA_SPLINE_TAPS = 6,    /* of a quintic spline, along an axis */
    HADA_SURFACE_SOURCES = 4 /* magnified images that are summed, at most */
};

/* Images [slot][channel][rows][cols] of spline coefficients, and where the tables stand that sample them: of each
 * source those of its rows, then those of its columns, rows + cols entries, from entry `table` on. */
typedef struct hada_surface_sources {
    int channels, rows, cols;
    unsigned int table;
    int count;                      /* sources */
    int slot[HADA_SURFACE_SOURCES]; /* of each source */
} hada_surface_sources;
HADA_SHARED_SIZE(hada_surface_sources, 36)

#endif
