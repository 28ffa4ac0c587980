/* A focus object's inside, for the files of lib/focus. */
#ifndef HADA_FOCUS_FOCUS_OBJECT_H
#define HADA_FOCUS_FOCUS_OBJECT_H

#include "focus/focus.h"
#include "launch/focus.h"

/* How the kernels part the work. */
typedef struct hada_focus_way {
    int groups;  /* work-groups of one item that take many tiles each, every one with counts of its own; 1 on a GPU */
    int depths;  /* planes of a launch, at most */
    int width;   /* pixels of an item of focus_select, which rows of the object's own images are multiples of */
    int members; /* items in a group */
    int rows, cols, band; /* tiles of focus_measure; rows of a tile of focus_select */
    hada_program_focus program;
} hada_focus_way;

struct hada_focus {
    hada_slot *slot;
    hada_focus_options options;
    int channels, rows, cols, depths;
    int radius, pitch, kinds; /* of the window; of a row; responses of a plane */
    hada_focus_way way;
    double noise_mean, noise_deviation;

    unsigned char *competing; /* per depth */
    int competing_count;
    int begun, next; /* depths below `next` have come */
    int last;        /* the last depth that competed, -1: none yet */
    int pushed;      /* depths that competed so far */

    hada_buffer weights, inverse_distances;
    hada_buffer response; /* of the planes of a launch, averaged across */
    hada_buffer kept;     /* the running best and the all-in-focus sums */
    hada_buffer bins, counts;
    int64_t counted;                      /* pixels in the device's counts, which are int */
    int64_t *noise_counts, *loser_counts; /* the counts before them */
};

hada_focus_way hada_focus_way_of(const hada_context *context);

/* Launches, for planes of one batch. */
hada_status hada_focus_launch_measure(hada_focus *focus, cl_mem planes, const hada_focus_batch *batch, hada_error *err);
hada_status hada_focus_launch_select(hada_focus *focus, cl_mem planes, const hada_focus_batch *batch, hada_error *err);
hada_status hada_focus_launch_counts(hada_focus *focus, hada_error *err);
hada_status hada_focus_launch_finish(hada_focus *focus, const hada_focus_report *found, double base,
                                     cl_mem all_in_focus, size_t all_in_focus_offset, cl_mem distance_map,
                                     size_t distance_offset, hada_error *err);

#endif
