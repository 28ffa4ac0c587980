/* Plans of convolutions: sizes, implementations, bytes; nothing is allocated. */
#include "net/conv_internal.h"

#include <limits.h>

#include "core/alloc.h"
#include "launch/conv_direct.h"
#include "launch/conv_few.h"
#include "launch/conv_group.h"
#include "launch/conv_tf32.h"
#include "launch/conv_weights.h"
#include "launch/conv_winograd.h"
#include "launch/conv_winograd_steps.h"
#include "launch/conv_winograd_weight_steps.h"
#include "launch/conv_winograd_weights.h"

/* Partial sums of gradients, measured by perf/perf_conv and perf/perf_train (docs/explanation/speed-and-accuracy.md).
 */
#define STRIP_ROWS     8                 /* added up in one running sum */
#define LEAST_PARTS    8                 /* by Winograd's tiles, of large weights */
#define PARTS_OF_UNIT  2                 /* of a compute unit */
#define MOST_PARTS     64                /* more would only write more sums */
#define PARTIAL_FLOATS ((size_t)1 << 20) /* of all parts together, 4 MiB */
#define CACHED_FLOATS  ((size_t)1 << 16) /* of a part's images, 256 KiB: they stay in a near cache */
#define PART_FLOATS    ((size_t)1 << 24) /* of the parts of a pass in work-groups, 64 MiB */
#define STEP_FLOATS    ((size_t)1 << 22) /* of transformed tiles in scratch, 16 MiB */
/* tiles that one step of a gradient of weights adds up in one running sum: more lose accuracy (1024: 6e-6) */
#define LEAST_STEP_TILES 64
#define MOST_STEP_TILES  256

#define FEW_COARSE 3 /* channels, of which gradients of weights make no lanes */

/* Winograd's F(4 x 4, 3 x 3): output pixels of a tile's side, and places of a tile. */
enum { TILE = 4, PLACES = (TILE + 2) * (TILE + 2) };

static int padded(int channels, int to)
{
    return (int)hada_round_up((size_t)channels, (size_t)to);
}

void hada_conv_output_size(const hada_conv_desc *desc, int *rows, int *cols)
{
    if (desc->transposed) {
        *rows = (desc->in_rows - 1) * desc->stride - 2 * desc->pad_rows + desc->kernel_rows + desc->output_pad;
        *cols = (desc->in_cols - 1) * desc->stride - 2 * desc->pad_cols + desc->kernel_cols + desc->output_pad;
    } else {
        const int rest_rows = desc->in_rows + 2 * desc->pad_rows - desc->kernel_rows;
        const int rest_cols = desc->in_cols + 2 * desc->pad_cols - desc->kernel_cols;
        *rows = rest_rows < 0 ? 0 : rest_rows / desc->stride + 1;
        *cols = rest_cols < 0 ? 0 : rest_cols / desc->stride + 1;
    }
}

static hada_status validate(const hada_conv_desc *d, hada_error *err)
{
    int rows, cols;
    if (d->images < 1 || d->in_channels < 1 || d->out_channels < 1 || d->in_rows < 1 || d->in_cols < 1 ||
        d->kernel_rows < 1 || d->kernel_cols < 1 || d->stride < 1 || d->pad_rows < 0 || d->pad_cols < 0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a convolution needs sizes, a kernel and a stride of at least 1 and padding of at least 0");
    if (d->transposed ? d->output_pad < 0 || d->output_pad >= d->stride : d->output_pad != 0)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "output padding is for transposed convolutions and smaller than the stride");
    if ((unsigned)d->activation > HADA_ACTIVATION_SIGMOID || (unsigned)d->method >= HADA_CONV_METHODS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a convolution with an unknown activation or method");
    hada_conv_output_size(d, &rows, &cols);
    if (rows < 1 || cols < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a %dx%d kernel does not fit into %dx%d pixels", d->kernel_rows,
                         d->kernel_cols, d->in_rows, d->in_cols);
    return HADA_OK;
}

/* Whether every read of a pass stays within the input and its halo of one. */
static int within_halo(int in, int out, int kernel, int pad, int in_step, int step)
{
    for (int phase = 0; phase < step && phase < out; phase++) {
        const hada_conv_taps taps = hada_conv_taps_of(kernel, pad, step, phase);
        const int last = (out - phase + step - 1) / step - 1;
        if (taps.count && (taps.first < -1 || last * in_step + taps.first + taps.count - 1 > in))
            return 0;
    }
    return 1;
}

/* In one launch where a work-item's tiles fit into local memory, else in three. */
static void plan_winograd(hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass,
                          const hada_conv_choice *choice)
{
    const size_t places = (size_t)((pass->tile + 2) * (pass->tile + 2));
    const size_t in = (size_t)padded(pass->in_channels, plan->block);
    const size_t out = (size_t)padded(pass->out_channels, plan->block);
    const size_t across = (size_t)padded(pass->out_cols, pass->tile) / (size_t)pass->tile;
    const size_t all = across * (size_t)(padded(pass->out_rows, pass->tile) / pass->tile);
    pass->method = pass->tile == 4 ? HADA_CONV_WINOGRAD4 : HADA_CONV_WINOGRAD2;
    hada_conv_table_tiles(context, pass);
    if (choice->method && choice->blocks > 0)
        pass->lanes = choice->blocks * plan->block;
    if (choice->method && choice->tiles >= 0)
        pass->tiles = choice->tiles;
    pass->weight_floats = places * in * out;
    pass->pixels = hada_conv_table_step(plan->block, 0);
    /* sums of twice the tiles find room in 32 registers, where there is one block of outputs */
    if (pass->tile == TILE && plan->block == 16 && pass->lanes == plan->block && pass->tiles % (2 * pass->pixels) == 0)
        pass->pixels *= 2;
    if (pass->tiles && (size_t)pass->tiles <= all)
        return;
    pass->pixels = hada_conv_table_step(plan->block, 1);
    const size_t floats = places * (in + out), step = (size_t)pass->pixels;
    const size_t most = STEP_FLOATS / floats / step * step, wanted = all * (size_t)plan->desc.images;
    const size_t room = most < step ? step : most < wanted ? most : (wanted + step - 1) / step * step;
    pass->tiles = 0;
    pass->room = (int)room;
    pass->scratch_floats = floats * room + places * 2 * (size_t)plan->block;
}

/* What the tuning file says, or `forced`: nothing where the description names a method itself. */
static hada_status choose(const hada_conv_plan *plan, const hada_context *context, const hada_conv_pass *pass, int near,
                          const hada_conv_choice *forced, hada_conv_choice *choice, hada_error *err)
{
    const hada_tuning_row *row = NULL;
    hada_status status = HADA_OK;
    *choice = forced ? *forced : (hada_conv_choice){.method = HADA_CONV_AUTO};
    if (plan->desc.method == HADA_CONV_AUTO && !forced)
        status = hada_conv_choice_find(context, plan, pass, choice, &row, err);
    const char *reason = status ? NULL : hada_conv_choice_misfit(context, plan, pass, near, choice);
    if (reason)
        status =
            row ? hada_tuning_refuse(context, row, reason, err) : hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s", reason);
    return status;
}

/* The sizes of a pass, whatever serves it. */
static hada_conv_pass sizes_of(const hada_conv_desc *d, int to_coarse)
{
    const int backward = to_coarse == d->transposed;
    int rows, cols;
    hada_conv_output_size(d, &rows, &cols);
    return (hada_conv_pass){.to_coarse = to_coarse,
                            .in_channels = backward ? d->out_channels : d->in_channels,
                            .in_rows = backward ? rows : d->in_rows,
                            .in_cols = backward ? cols : d->in_cols,
                            .out_channels = backward ? d->in_channels : d->out_channels,
                            .out_rows = backward ? d->in_rows : rows,
                            .out_cols = backward ? d->in_cols : cols,
                            .in_step = to_coarse ? d->stride : 1,
                            .step = to_coarse ? 1 : d->stride,
                            .taps_rows = to_coarse ? d->kernel_rows - 1 - d->pad_rows : d->pad_rows,
                            .taps_cols = to_coarse ? d->kernel_cols - 1 - d->pad_cols : d->pad_cols};
}

/* Whether reads of a pass stay within the halo. */
static int is_near(const hada_conv_desc *d, const hada_conv_pass *pass)
{
    return within_halo(pass->in_rows, pass->out_rows, d->kernel_rows, pass->taps_rows, pass->in_step, pass->step) &&
           within_halo(pass->in_cols, pass->out_cols, d->kernel_cols, pass->taps_cols, pass->in_step, pass->step);
}

/* Tiles of registers by the table, or as chosen. */
static void plan_direct(const hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass,
                        const hada_conv_choice *choice)
{
    hada_conv_table_pass(context, pass);
    if (plan->groups)
        hada_conv_table_group(context, pass, plan->desc.kernel_rows * plan->desc.kernel_cols);
    if (plan->desc.method == HADA_CONV_DIRECT)
        pass->parts = 1; /* tiles of an image hold the bits of the whole (net/enhance_shape.c) */
    const int chosen = choice->method == HADA_CONV_DIRECT;
    if (plan->groups)
        return;
    pass->lanes = chosen && choice->blocks > 0 ? choice->blocks * plan->block : pass->lanes;
    pass->pixels = chosen && choice->pixels > 0 ? choice->pixels : pass->pixels;
    pass->rows_each = chosen && choice->rows > 0 ? choice->rows : pass->rows_each;
    if ((chosen && choice->blocks > 0) || !pass->lanes || pass->in_step > 1 || pass->step > 1)
        return;
    const int taps = plan->desc.kernel_rows * plan->desc.kernel_cols;
    hada_conv_table_few(context, pass, taps);
    if (!pass->few && !(chosen && choice->rows > 0))
        hada_conv_table_flat(context, pass, taps);
}

/* Floats of the weights in the order of conv_pack, or as they are. */
static size_t direct_weight_floats(const hada_conv_plan *plan, const hada_conv_pass *pass)
{
    const hada_conv_desc *d = &plan->desc;
    const size_t step = (size_t)pass->step;
    if (pass->method == HADA_CONV_PLAIN)
        return (size_t)d->in_channels * (size_t)d->out_channels * (size_t)d->kernel_rows * (size_t)d->kernel_cols;
    return step * step * hada_divide_up((size_t)d->kernel_rows, step) * hada_divide_up((size_t)d->kernel_cols, step) *
           (size_t)padded(pass->in_channels, plan->block) * (size_t)padded(pass->out_channels, pass->lanes);
}

/* Scratch for the sums of parts, of as many images as find room. */
static void plan_parts(const hada_conv_plan *plan, hada_conv_pass *pass)
{
    const size_t floats = (size_t)pass->parts * (size_t)padded(pass->out_channels, plan->block) *
                          (size_t)pass->out_rows * (size_t)pass->out_cols;
    const size_t room = PART_FLOATS / floats, images = (size_t)plan->desc.images;
    pass->images_each = (int)(pass->parts < 2 || room > images ? images : room < 1 ? 1 : room);
    pass->scratch_floats = pass->parts < 2 ? 0 : floats * (size_t)pass->images_each;
}

static hada_status plan_pass(hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass, int to_coarse,
                             const hada_conv_choice *forced, hada_error *err)
{
    hada_conv_choice choice;
    *pass = sizes_of(&plan->desc, to_coarse);
    const int near = is_near(&plan->desc, pass);
    const hada_status status = choose(plan, context, pass, near, forced, &choice, err);
    if (status)
        return status;
    hada_conv_desc wanted = plan->desc;
    wanted.method = choice.method ? choice.method : plan->desc.method;
    pass->method = plan->groups && wanted.method == HADA_CONV_TF32 ? HADA_CONV_TF32 : HADA_CONV_DIRECT;
    plan_direct(plan, context, pass, &choice);
    if (plan->groups && wanted.method == HADA_CONV_AUTO && hada_conv_table_tf32(context, pass))
        pass->method = HADA_CONV_TF32;
    if (!near || !pass->lanes || wanted.method == HADA_CONV_PLAIN)
        pass->method = HADA_CONV_PLAIN;
    pass->tile = hada_conv_is_winograd(plan) ? hada_conv_table_winograd(context, &wanted, pass) : 0;
    if (pass->tile) {
        const hada_conv_pass direct = *pass;
        plan_winograd(plan, context, pass, &choice);
        if (pass->tiles || pass->tile == TILE)
            return HADA_OK;
        *pass = direct; /* there are no three launches for tiles of 2 x 2 */
        pass->tile = 0;
    }
    pass->weight_floats = direct_weight_floats(plan, pass);
    if (plan->groups && pass->method != HADA_CONV_PLAIN)
        plan_parts(plan, pass);
    return HADA_OK;
}

static void need_scratch(hada_conv_plan *plan, size_t floats)
{
    if (floats > plan->scratch_floats)
        plan->scratch_floats = floats;
}

/* The transformed gradients of all parts, or of one part and the transformed tiles of a launch. */
static void plan_gradient_tiles(hada_conv_plan *plan, const hada_context *context, hada_conv_gradient *g)
{
    const size_t coarse = (size_t)padded(g->coarse_channels, plan->block);
    const size_t fine = (size_t)padded(g->fine_channels, plan->block), places = PLACES;
    g->method = HADA_CONV_WINOGRAD4;
    hada_conv_table_gradient_tiles(context, g);
    g->part_floats = places * coarse * fine;
    if (g->tiles) {
        /* parts are all that compute units share out, and each writes its sums */
        const size_t wanted = PARTIAL_FLOATS / g->part_floats, units = context->info.compute_units;
        const size_t most = units < 2 ? 1 : PARTS_OF_UNIT * units < MOST_PARTS ? PARTS_OF_UNIT * units : MOST_PARTS;
        g->parts = (int)(wanted < LEAST_PARTS ? LEAST_PARTS : wanted);
        if ((size_t)g->parts > most)
            g->parts = (int)most;
        need_scratch(plan, (g->part_floats + coarse) * (size_t)g->parts);
        return;
    }
    const size_t all = (size_t)(padded(g->fine_rows, TILE) / TILE) * (size_t)(padded(g->fine_cols, TILE) / TILE) *
                       (size_t)plan->desc.images;
    size_t most = STEP_FLOATS / (places * (coarse + fine));
    most = most < LEAST_STEP_TILES ? LEAST_STEP_TILES : most < MOST_STEP_TILES ? most : MOST_STEP_TILES;
    g->room = (int)(most < all ? most : all);
    need_scratch(plan, places * ((coarse + fine) * (size_t)g->room + 2 * (size_t)plan->block) + g->part_floats);
}

/* Tiles of registers or of local memory, and parts. */
static void plan_gradient_sums(hada_conv_plan *plan, const hada_context *context, hada_conv_gradient *g)
{
    const hada_conv_desc *d = &plan->desc;
    hada_conv_table_gradient(context, d, g);
    const int coarse_tile = plan->groups ? HADA_CONV_GRADIENT_LANES : g->blocks * plan->block;
    const int fine_tile = plan->groups ? HADA_CONV_GRADIENT_LANES : g->fine_each;
    if (plan->groups)
        g->cols_each = g->rows_each = 1;
    g->coarse_groups = padded(g->coarse_channels, coarse_tile) / coarse_tile;
    g->fine_groups = padded(g->fine_channels, fine_tile) / fine_tile;
    g->strip_rows = STRIP_ROWS;
    g->part_floats = (size_t)(g->coarse_groups * coarse_tile) * (size_t)(g->fine_groups * fine_tile) *
                     (size_t)d->kernel_rows * (size_t)d->kernel_cols;
    /* a part's images stay in the nearest cache; more parts would only write more sums */
    const size_t wanted = PARTIAL_FLOATS / g->part_floats, images = (size_t)d->images;
    const size_t values = (size_t)(g->coarse_channels * g->coarse_rows) * (size_t)g->coarse_cols +
                          (size_t)(g->fine_channels * g->fine_rows) * (size_t)g->fine_cols;
    const size_t useful = plan->groups ? MOST_PARTS : hada_divide_up(values * images, CACHED_FLOATS);
    g->parts = (int)(wanted < useful ? wanted : useful);
    g->parts = g->parts < 1 ? 1 : g->parts > MOST_PARTS ? MOST_PARTS : g->parts;
}

/* Sums have a lane for each coarse channel. Where those are few, and both images of one size, the fine ones take their
 * place: dw[a][b][u][v] = sum of fine[b][r][c] coarse[a][r + pad - u][c + pad - v]. */
static void swap_where_few(const hada_conv_plan *plan, hada_conv_gradient *g)
{
    const hada_conv_desc *d = &plan->desc;
    const int same_size = d->stride == 1 && 2 * d->pad_rows == d->kernel_rows - 1 &&
                          2 * d->pad_cols == d->kernel_cols - 1 && !d->output_pad;
    const int few = g->coarse_channels <= FEW_COARSE && g->fine_channels > g->coarse_channels;
    g->swapped = g->method == HADA_CONV_DIRECT && !plan->groups && same_size && few;
    if (g->swapped) {
        const int fine = g->fine_channels;
        g->fine_channels = g->coarse_channels;
        g->coarse_channels = fine;
    }
}

static void plan_gradient(hada_conv_plan *plan, const hada_context *context)
{
    const hada_conv_desc *d = &plan->desc;
    const hada_conv_pass pass = sizes_of(d, 1); /* to coarse: from the fine image */
    hada_conv_gradient *g = &plan->gradient;
    *g = (hada_conv_gradient){.coarse_channels = pass.out_channels,
                              .coarse_rows = pass.out_rows,
                              .coarse_cols = pass.out_cols,
                              .fine_channels = pass.in_channels,
                              .fine_rows = pass.in_rows,
                              .fine_cols = pass.in_cols,
                              .bias_parts = MOST_PARTS};
    g->method = is_near(d, &pass) && d->method != HADA_CONV_PLAIN ? HADA_CONV_DIRECT : HADA_CONV_PLAIN;
    need_scratch(plan, (size_t)MOST_PARTS * (size_t)padded(d->out_channels, plan->block)); /* of the biases */
    g->tile = hada_conv_is_winograd(plan) ? hada_conv_table_gradient_winograd(context, d, g) : 0;
    if (g->tile) {
        plan_gradient_tiles(plan, context, g);
        return;
    }
    swap_where_few(plan, g);
    if (g->method != HADA_CONV_PLAIN)
        plan_gradient_sums(plan, context, g);
    need_scratch(plan, g->part_floats * (size_t)g->parts);
}

/* The programs that serve, by the values of their macros; where there are no numbers to choose by, the launch names the
 * program. */
static int pass_program(const hada_conv_plan *plan, const hada_context *context, const hada_conv_pass *pass)
{
    const int block = plan->block, blocks = pass->lanes / block;
    if (pass->tile && pass->tiles)
        return hada_find_conv_winograd(.net_block = block, .conv_blocks = blocks, .conv_pixels = pass->pixels,
                                       .conv_tile = pass->tile);
    if (pass->tile)
        return hada_find_conv_winograd_steps(.net_block = block, .conv_blocks = blocks, .conv_pixels = pass->pixels,
                                             .conv_tile = pass->tile);
    if (pass->method == HADA_CONV_TF32)
        return hada_find_conv_tf32(.net_block = block, .conv_high = pass->lanes,
                                   .conv_mma = context->tensor_cores && block == 8);
    if (pass->method == HADA_CONV_DIRECT && pass->few)
        return hada_find_conv_few(.net_block = block, .conv_few = pass->few, .conv_pixels = pass->pixels);
    if (pass->method == HADA_CONV_DIRECT && !plan->groups)
        return hada_find_conv_direct(.net_block = block, .conv_blocks = blocks, .conv_pixels = pass->pixels,
                                     .conv_step = pass->in_step);
    if (pass->method == HADA_CONV_DIRECT)
        return hada_find_conv_group(.net_block = block, .conv_high = pass->lanes, .conv_pixels = pass->pixels);
    return 0;
}

static int gradient_program(const hada_conv_plan *plan)
{
    const hada_conv_gradient *g = &plan->gradient;
    if (g->tile && g->tiles)
        return hada_find_conv_winograd_weights(.net_block = plan->block, .conv_blocks = g->blocks,
                                               .conv_fine = g->fine_each);
    if (g->tile)
        return hada_find_conv_winograd_weight_steps(.net_block = plan->block, .conv_blocks = g->blocks,
                                                    .conv_fine = g->fine_each);
    if (g->method == HADA_CONV_DIRECT && !plan->groups)
        return hada_find_conv_weights(.net_block = plan->block, .conv_blocks = g->blocks, .conv_fine = g->fine_each,
                                      .conv_cols = g->cols_each, .conv_rows = g->rows_each);
    return 0;
}

/* Whether the channels that are doubled can be, now that it is known what serves. */
static hada_status check_doubled(const hada_conv_plan *plan, hada_error *err)
{
    const hada_conv_desc *d = &plan->desc;
    const int before = d->in_channels - d->doubled;
    if (!d->doubled || (d->doubled > 0 && before > 0 && before % plan->block == 0 && d->in_rows % 2 == 0 &&
                        d->in_cols % 2 == 0 && !d->training && plan->pass[HADA_CONV_FORWARD].tile == TILE))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "a convolution that doubles %d of %d channels of %dx%d pixels: resize them first", d->doubled,
                     d->in_channels, d->in_rows, d->in_cols);
}

hada_status hada_conv_plan_make(hada_conv_plan *plan, const hada_context *context, const hada_conv_desc *desc,
                                const hada_conv_choice *forced, hada_error *err)
{
    HADA_TRY(validate(desc, err));
    *plan = (hada_conv_plan){.desc = *desc,
                             .block = hada_net_block(context),
                             .groups = context->shape == HADA_SHAPE_GROUPS,
                             .pass_count = desc->training ? HADA_CONV_PASSES : 1};
    HADA_TRY(plan_pass(plan, context, &plan->pass[HADA_CONV_FORWARD], !desc->transposed, forced, err));
    if (desc->training) {
        HADA_TRY(plan_pass(plan, context, &plan->pass[HADA_CONV_DATA], desc->transposed, NULL, err));
        plan_gradient(plan, context);
        plan->gradient.program = gradient_program(plan);
    }
    HADA_TRY(check_doubled(plan, err));
    for (int p = 0; p < plan->pass_count; p++) {
        need_scratch(plan, plan->pass[p].scratch_floats);
        plan->pass[p].program = pass_program(plan, context, &plan->pass[p]);
    }
    return HADA_OK;
}
