/* How a convolution is carried out: a plan, made from its sizes alone. Internal to lib/net.
 *
 * "Coarse" is the output of a convolution and the input of a transposed one; "fine" the other. Both have weights
 * [coarse][fine][kernel row][kernel column], so a convolution's gradient of its input is a transposed convolution of
 * its output's gradient, and the other way round: two passes, to coarse and to fine, do everything. */
#ifndef HADA_NET_CONV_PLAN_H
#define HADA_NET_CONV_PLAN_H

#include "kernels/shared_conv.h"
#include "net/conv.h"

/* One pass over an image: `out` from `in`. A pass to fine with stride 1 is one to coarse with mirrored weights. */
typedef struct hada_conv_pass {
    hada_conv_method method;
    int to_coarse;
    int in_channels, in_rows, in_cols, out_channels, out_rows, out_cols;
    int in_step, step;        /* pixels of the input and of the output from one place of the kernel to the next */
    int taps_rows, taps_cols; /* padding as hada_conv_taps_of() counts it */
    int lanes;                /* output channels in a group of the packed weights */
    int pixels;               /* pixels, or tiles, at a time */
    int few;                  /* direct: output channels that conv_few.cl takes; 0: conv_direct.cl serves */
    int rows_each;            /* direct: rows of a work-item, or tiles where it is */
    int flat;                 /* direct: rows taken as one long row */
    int winograd;             /* by tiles of 4 x 4 */
    int tiles;                /* Winograd in one launch: tiles of a work-item; 0: in three launches */
    int room;                 /* Winograd in three launches: tiles at most */
    int parts;                /* direct in work-groups: groups that share the steps of a tile */
    int images_each;          /* then: images whose sums find room in scratch */
    int program;              /* of the kernel file that serves it: a row of the manifest */
    size_t scratch_floats;
    size_t weight_floats;
} hada_conv_pass;

/* The gradient of the weights: sums over strips of rows, shared out to parts. */
typedef struct hada_conv_gradient {
    hada_conv_method method;
    int swapped; /* what is called fine here is the convolution's coarse image, and the other way round */
    int coarse_channels, coarse_rows, coarse_cols, fine_channels, fine_rows, fine_cols;
    int blocks, fine_each, cols_each, rows_each; /* of a work-item; columns and rows of the kernel */
    int coarse_groups, fine_groups;
    int strip_rows, parts, bias_parts; /* at most so many parts */
    size_t part_floats;
    int winograd;
    int tiles; /* Winograd: tiles at a time in local memory; 0: all steps in launches of their own, through scratch */
    int room;  /* then: tiles at most */
    int program;
} hada_conv_gradient;

/* Whether convolutions by TF32 were tried on the context's device (context->tf32); AUTO takes them where they are
 * right. */
enum { HADA_CONV_TF32_UNTRIED, HADA_CONV_TF32_RIGHT, HADA_CONV_TF32_WRONG };

enum { HADA_CONV_FORWARD = 0, HADA_CONV_DATA = 1, HADA_CONV_PASSES = 2 };

typedef struct hada_conv_plan {
    hada_conv_desc desc;
    int block, groups, pass_count;
    hada_conv_pass pass[HADA_CONV_PASSES];
    hada_conv_gradient gradient;
    size_t scratch_floats;
} hada_conv_plan;

/* Fills the plan, or says why the channels that are doubled cannot be. */
hada_status hada_conv_plan_make(hada_conv_plan *plan, const hada_context *context, const hada_conv_desc *desc,
                                hada_error *err);

/* Pixels of a tile of work-groups. */
static inline int hada_conv_group_tile(const hada_conv_pass *pass)
{
    return pass->pixels * HADA_CONV_GROUP_ITEMS / (pass->lanes > 8 ? pass->lanes / 8 : 1);
}

/* A convolution on its device, and the launches of each implementation. */

struct hada_conv {
    hada_slot *slot;
    hada_conv_plan plan;
    hada_buffer weights[HADA_CONV_PASSES], scratch;
};

/* What is done with a finished sum (hada_conv_epilogue). */
typedef struct hada_conv_finish {
    hada_floats bias;
    hada_activation activation;
    float slope;
    const hada_tensor *mask, *pooled; /* NULL: none */
    int accumulate;
} hada_conv_finish;

static inline cl_mem hada_conv_mask(const hada_conv_finish *finish)
{
    return finish->mask ? finish->mask->mem : NULL;
}

#endif
