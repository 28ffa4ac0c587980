/* How a convolution is carried out: plans made from its sizes alone, and the launches of each implementation. Internal
 * to lib/net/conv*.c.
 *
 * "Coarse" is the output of a convolution and the input of a transposed one; "fine" the other. Both have weights
 * [coarse][fine][kernel row][kernel column], so a convolution's gradient of its input is a transposed convolution of
 * its output's gradient, and the other way round: two passes, to coarse and to fine, serve everything. */
#ifndef HADA_NET_CONV_INTERNAL_H
#define HADA_NET_CONV_INTERNAL_H

#include "kernels/shared_conv.h"
#include "net/conv.h"
#include "runtime/tuning.h"

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
    int tile;                 /* Winograd: 2 or 4 */
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
    int tile;  /* Winograd: 4, else 0 */
    int tiles; /* Winograd: tiles at a time in local memory; 0: all steps in launches of their own, through scratch */
    int room;  /* then: tiles at most */
    int program;
} hada_conv_gradient;

/* What the tuning file, or the tuner, has chosen for a pass; AUTO: nothing, the table decides. Negative: as the table
 * has it. */
typedef struct hada_conv_choice {
    hada_conv_method method;
    int blocks;       /* of output channels in a work-item */
    int pixels, rows; /* direct: pixels at a time, rows of a work-item */
    int tiles;        /* Winograd: tiles of a work-item, 0: in three launches */
} hada_conv_choice;

enum { HADA_CONV_FORWARD = 0, HADA_CONV_DATA = 1, HADA_CONV_PASSES = 2 };

typedef struct hada_conv_plan {
    hada_conv_desc desc;
    int block, groups, pass_count;
    hada_conv_pass pass[HADA_CONV_PASSES];
    hada_conv_gradient gradient;
    size_t scratch_floats;
} hada_conv_plan;

struct hada_conv {
    hada_slot *slot;
    hada_conv_plan plan;
    hada_buffer weights[HADA_CONV_PASSES], scratch;
    int has_weights;
};

/* Fills the plan, or says what is wrong with the description. `forced` (NULL: none) is for the forward pass, instead of
 * what the tuning file says. */
hada_status hada_conv_plan_make(hada_conv_plan *plan, const hada_context *context, const hada_conv_desc *desc,
                                const hada_conv_choice *forced, hada_error *err);

/* As hada_conv_create(), with a choice for the forward pass. */
hada_status hada_conv_create_chosen(hada_conv **out, hada_slot *slot, const hada_conv_desc *desc,
                                    const hada_conv_choice *forced, hada_error *err);

/* The words of a pass in the tuning file (conv_choice.c): its shape, and what serves it. */
void hada_conv_shape_text(const hada_conv_plan *plan, int pass, char *text, size_t size);
void hada_conv_choice_text(const hada_conv_plan *plan, int pass, char *text, size_t size);

/* Whether convolutions of TF32 are known to be right on the context's device: only then do they serve unasked. */
enum { HADA_CONV_TF32_UNTRIED, HADA_CONV_TF32_RIGHT, HADA_CONV_TF32_WRONG };

/* What the tuning file says of a pass; *row is its row, NULL where there is none. */
hada_status hada_conv_choice_find(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                  hada_conv_choice *choice, const hada_tuning_row **row, hada_error *err);

/* NULL where a choice can serve a pass, else why not. `near`: its reads stay within the halo. */
const char *hada_conv_choice_misfit(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                    int near, const hada_conv_choice *choice);

/* The choices that could serve the forward pass of a plan, for a tuner, the likely ones first; returns how many.
 * Kernels are those of the manifest alone, so that a tuning file holds for offline devices too. */
enum { HADA_CONV_VARIANTS = 64 };
int hada_conv_variants(const hada_context *context, const hada_conv_plan *plan,
                       hada_conv_choice choices[HADA_CONV_VARIANTS]);

/* Whether Winograd's tiles fit the shape at all. */
static inline int hada_conv_is_winograd(const hada_conv_plan *plan)
{
    const hada_conv_desc *d = &plan->desc;
    return d->kernel_rows == 3 && d->kernel_cols == 3 && d->stride == 1 && d->pad_rows == 1 && d->pad_cols == 1 &&
           !d->output_pad && !plan->groups;
}

/* Tile sizes and methods that the table of conv_table.c gives. hada_conv_table_winograd() gives the size of Winograd's
 * tiles, 0 for another method. */
int hada_conv_table_winograd(const hada_context *context, const hada_conv_desc *desc, const hada_conv_pass *pass);
int hada_conv_table_gradient_winograd(const hada_context *context, const hada_conv_desc *desc,
                                      const hada_conv_gradient *gradient);
void hada_conv_table_tiles(const hada_context *context, hada_conv_pass *pass);
/* Whether the rows of a narrow image are taken as one, where both images are of one size; once the tile is chosen. */
void hada_conv_table_flat(const hada_context *context, hada_conv_pass *pass, int taps);
/* Whether conv_few.cl serves a direct pass with these taps, stride 1 and few output channels. */
void hada_conv_table_few(const hada_context *context, hada_conv_pass *pass, int taps);
/* Whether there is a direct kernel for so many blocks and pixels that takes the pass; number `index` of those that do,
 * 0 when there are no more; tiles that Winograd's kernels for one launch and for three take at a time, and whether a
 * work-item's tiles find room. */
int hada_conv_table_direct(const hada_context *context, const hada_conv_pass *pass, int blocks, int pixels);
int hada_conv_table_direct_at(const hada_context *context, const hada_conv_pass *pass, int index, int *blocks,
                              int *pixels);
int hada_conv_table_step(int block, int three_launches);
int hada_conv_table_tiles_fit(const hada_context *context, const hada_conv_pass *pass, int blocks, int tiles);
void hada_conv_table_gradient_tiles(const hada_context *context, hada_conv_gradient *gradient);
void hada_conv_table_pass(const hada_context *context, hada_conv_pass *pass);
/* Whether a pass in work-groups goes by TF32 where nobody says otherwise, with the tile that it has: bytes stay the
 * same. */
int hada_conv_table_tf32(const hada_context *context, const hada_conv_pass *pass);
/* In work-groups: output channels of a tile, pixels of an item, and parts, of a kernel with so many places; by the
 * pass's method. */
void hada_conv_table_group(const hada_context *context, hada_conv_pass *pass, int places);
void hada_conv_table_gradient(const hada_context *context, const hada_conv_desc *desc, hada_conv_gradient *gradient);

/* Pixels of a tile of work-groups. */
static inline int hada_conv_group_tile(const hada_conv_pass *pass)
{
    return pass->pixels * HADA_CONV_GROUP_ITEMS / (pass->lanes > 8 ? pass->lanes / 8 : 1);
}

/* What is done with a finished sum (hada_conv_epilogue). */
typedef struct hada_conv_finish {
    hada_floats bias;
    hada_activation activation;
    float slope;
    const hada_tensor *mask, *pooled; /* NULL: none */
    int accumulate;
} hada_conv_finish;

/* States what the next launch needs at least, for profiles: the products of the definition. */
void hada_conv_cost(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine);

/* What kernels take of a pass, and of the gradient of the weights. pools: the pooled output is written at once. */
hada_conv_problem hada_conv_problem_of(const hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                                       const hada_conv_finish *finish, int pools);
hada_conv_correlation hada_conv_correlation_of(const hada_conv *conv, const hada_tensor *coarse,
                                               const hada_tensor *fine);

static inline cl_mem hada_conv_mask(const hada_conv_finish *finish)
{
    return finish->mask ? finish->mask->mem : NULL;
}

hada_status hada_conv_pack(hada_conv *conv, int pass, hada_floats weights, hada_error *err);
/* Whether a pass can run on these tensors, and what it will cost. low: the doubled channels; NULL: none. */
hada_status hada_conv_ready(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *low,
                            const hada_tensor *out, const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_run(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *low,
                          const hada_tensor *out, const hada_conv_finish *finish, hada_error *err);

/* Launches of one implementation; pooling is done in a launch of its own where the implementation does not. */
hada_status hada_conv_direct(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                             const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_plain(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *out,
                            const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_winograd(hada_conv *conv, int pass, const hada_tensor *in, const hada_tensor *low,
                               const hada_tensor *out, const hada_conv_finish *finish, hada_error *err);
hada_status hada_conv_winograd_pack(hada_conv *conv, int pass, hada_floats weights, hada_error *err);
hada_status hada_conv_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine, hada_floats dw,
                              int accumulate, hada_error *err);
/* Also db (NULL: none) where the coarse image is dy. */
hada_status hada_conv_winograd_weights(hada_conv *conv, const hada_tensor *coarse, const hada_tensor *fine,
                                       hada_floats dw, hada_floats db, int accumulate, hada_error *err);
hada_status hada_conv_reduce_bias(hada_conv *conv, size_t scratch_offset, int parts, int channels, hada_floats db,
                                  int accumulate, hada_error *err);
hada_status hada_conv_bias(hada_conv *conv, const hada_tensor *dy, hada_floats db, int accumulate, hada_error *err);

#endif
