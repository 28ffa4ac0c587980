/* How a convolution is carried out: implementation, tile sizes, shares of the work, bytes. Everything follows from its
 * sizes and the device, by tables that were measured once (docs/explanation/speed-and-accuracy.md); nothing is timed or
 * allocated here. */
#include "net/conv_plan.h"

#include <limits.h>

#include "launch/conv_direct.h"
#include "launch/conv_few.h"
#include "launch/conv_group.h"
#include "launch/conv_tf32.h"
#include "launch/conv_weights.h"
#include "launch/conv_winograd.h"
#include "launch/conv_winograd_steps.h"
#include "launch/conv_winograd_weight_steps.h"
#include "launch/conv_winograd_weights.h"

/* Winograd's F(4 x 4, 3 x 3): output pixels of a tile's side, and places of a tile. */
enum { TILE = 4, PLACES = (TILE + 2) * (TILE + 2) };

/* Vectors that a work-item sums in: as many as registers hold besides the operands. */
typedef struct tile_row {
    int block, in_step; /* of the device and the pass */
    int blocks, pixels;
} tile_row;

/* Rows of one (block, in_step): the quickest for a row of pixels (cost_of) serves, the first of equal ones. */
static const tile_row tile_rows[] = {
    {16, 1, 2, 13}, {16, 1, 2, 8}, {16, 1, 1, 13}, {16, 1, 1, 8}, {16, 1, 1, 1}, {16, 2, 2, 8}, {16, 2, 1, 8},
    {16, 2, 1, 1},  {8, 1, 2, 6},  {8, 1, 1, 6},   {8, 1, 1, 1},  {8, 2, 2, 6},  {8, 2, 1, 6},  {8, 2, 1, 1},
};

/* So many work-items at least are left to share out. */
#define LEAST_ITEMS 64

static int tile_fits(const tile_row *row, int block, const hada_conv_pass *pass)
{
    const int out_blocks = (pass->out_channels + block - 1) / block, narrowest = pass->out_cols / pass->step;
    return row->block == block && row->in_step == pass->in_step && out_blocks % row->blocks == 0 &&
           (row->pixels <= narrowest || row->pixels == 1);
}

/* Time of a row of pixels for an input channel, with what tiles that overlap do twice: a tile takes as long as its
 * multiply-adds, its loads, or the wait for one sum, and a little more. */
static long cost_of(const tile_row *row, const hada_conv_pass *pass)
{
    const int width = (pass->out_cols + pass->step - 1) / pass->step;
    const long steps = (width + row->pixels - 1) / row->pixels, sums = (long)row->pixels * row->blocks;
    const long loads = row->pixels + row->blocks, work = sums > loads ? sums : loads;
    return steps * ((work > 8 ? work : 8) + 2) * 2 / row->blocks;
}

/* The same for all rows as one long row with the halo between them. */
static long flat_cost_of(const tile_row *row, const hada_conv_pass *pass)
{
    hada_conv_pass flat = *pass;
    flat.out_cols = pass->out_rows * (pass->out_cols + 2) - 2;
    return cost_of(row, &flat);
}

/* Work-items of a compute unit, where each reads weights of its own. */
#define FLAT_ITEMS 4
/* So many products of a pixel at least: finding out which pixels are halo is work of its own. */
#define FLAT_PRODUCTS 128
/* It is taken where it needs less than so much of the time, in percent. */
#define FLAT_GAIN 90

static void choose_flat(const hada_context *context, hada_conv_pass *pass, int taps)
{
    const int block = hada_net_block(context), out_blocks = (pass->out_channels + block - 1) / block;
    const int positions = pass->out_rows * (pass->out_cols + 2) - 2;
    const tile_row *best = NULL, now = {block, 1, pass->lanes / block, pass->pixels};
    pass->flat = 0;
    if (pass->in_rows != pass->out_rows || pass->in_cols != pass->out_cols || taps * pass->in_channels < FLAT_PRODUCTS)
        return;
    for (size_t i = 0; i < HADA_COUNT(tile_rows); i++) {
        const tile_row *row = &tile_rows[i];
        if (row->block == block && row->in_step == 1 && out_blocks % row->blocks == 0 && row->pixels <= positions &&
            (!best || flat_cost_of(row, pass) < flat_cost_of(best, pass)))
            best = row;
    }
    if (!best || 100 * flat_cost_of(best, pass) >= FLAT_GAIN * pass->out_rows * cost_of(&now, pass))
        return;
    /* tiles one after the other share weights, of which there are more than of pixels */
    const long units = context->info.compute_units, tiles = (positions + best->pixels - 1) / best->pixels;
    const long groups = out_blocks / best->blocks, each = tiles * groups / (FLAT_ITEMS * units);
    pass->flat = 1;
    pass->lanes = best->blocks * block;
    pass->pixels = best->pixels;
    pass->rows_each = each < 1 ? 1 : (int)each;
}

static void choose_direct(const hada_context *context, hada_conv_pass *pass)
{
    const int block = hada_net_block(context);
    const tile_row *best = NULL;
    for (size_t i = 0; i < HADA_COUNT(tile_rows); i++)
        if (tile_fits(&tile_rows[i], block, pass) && (!best || cost_of(&tile_rows[i], pass) < cost_of(best, pass)))
            best = &tile_rows[i];
    pass->lanes = best ? best->blocks * block : 0;
    pass->pixels = best ? best->pixels : 0;
    /* rows one after the other share weights in the nearest cache; enough groups of them are left to share out */
    const long groups = best ? (pass->out_channels + pass->lanes - 1) / pass->lanes : 1;
    const long rows = groups * pass->out_rows / LEAST_ITEMS;
    pass->rows_each = rows < 1 ? 1 : (int)rows;
}

/* Local memory that drivers for CPUs bear. */
#define LOCAL_BORNE ((size_t)500 << 10)

static size_t local_borne(const hada_context *context)
{
    return context->info.local_memory_bytes < LOCAL_BORNE ? context->info.local_memory_bytes : LOCAL_BORNE;
}

/* Output channels and pixels of conv_few.cl. */
static const struct {
    int block, few, pixels;
} few_rows[] = {{16, 1, 14}, {16, 3, 8}, {8, 1, 8}, {8, 3, 4}};

/* Vector instructions that add up the lanes of a sum. */
#define LANES_SUM 8

static void choose_few(const hada_context *context, hada_conv_pass *pass, int taps)
{
    const int block = hada_net_block(context), blocks = (pass->in_channels + block - 1) / block;
    pass->few = 0;
    for (size_t i = 0; i < HADA_COUNT(few_rows) && !pass->few; i++) {
        const int few = few_rows[i].few;
        const size_t local = (size_t)(blocks * block * taps * few) * sizeof(float);
        if (few_rows[i].block == block && pass->out_channels <= few && pass->out_cols >= few_rows[i].pixels &&
            few * (taps * blocks + LANES_SUM) < taps * pass->in_channels && local <= local_borne(context)) {
            pass->few = few;
            pass->lanes = block;
            pass->pixels = few_rows[i].pixels;
        }
    }
}

/* Tiles of conv_group.cl, of which conv_tf32.cl has the first. Pixels of an item: fewer where local memory would not
 * hold them. Few channels are one block of eight, the rest of which the same items make zero. */
static const struct {
    int lanes, pixels;
} group_rows[] = {{64, 8}, {32, 8}, {16, 4}, {4, 3}};
enum { GROUP_ROWS = sizeof group_rows / sizeof *group_rows, TF32_ROWS = 2, FEW = 4 };

/* Fewer leave parts of each of the tensor cores' products to zeros. */
#define TF32_IN_CHANNELS 8

static int is_tf32_quicker(const hada_context *context, const hada_conv_pass *pass)
{
    return atomic_load(&context->tf32) == HADA_CONV_TF32_RIGHT && pass->in_channels >= TF32_IN_CHANNELS &&
           pass->lanes >= group_rows[TF32_ROWS - 1].lanes;
}

/* A tile costs as if it had so many more channels: reading its pixels. */
#define GROUP_READS 4
/* Groups that a large device wants: two for each of its units. Where one image has fewer, several share a tile, each
 * so many steps at least. One image alone decides: results do not change with the batch. */
#define GROUPS_WANTED 256
#define PART_STEPS    8
#define PARTS_MOST    16

static void choose_group(const hada_context *context, hada_conv_pass *pass, int places)
{
    const int few = pass->out_channels <= FEW && hada_net_block(context) == 8;
    const int rows = pass->method == HADA_CONV_TF32 ? TF32_ROWS : few ? GROUP_ROWS : GROUP_ROWS - 1;
    long best = 0;
    for (int i = 0; i < rows; i++) {
        const long groups = (pass->out_channels + group_rows[i].lanes - 1) / group_rows[i].lanes;
        const long cost = groups * (group_rows[i].lanes + GROUP_READS);
        if (!best || cost < best) {
            best = cost;
            pass->lanes = group_rows[i].lanes;
            pass->pixels = group_rows[i].pixels;
        }
    }
    const int step = pass->step, tile = hada_conv_group_tile(pass);
    const int blocks = (int)hada_round_up((size_t)pass->in_channels, (size_t)hada_net_block(context)) / 8;
    const long pixels = (long)((pass->out_rows + step - 1) / step) * ((pass->out_cols + step - 1) / step);
    const long tiles = (pixels + tile - 1) / tile * ((pass->out_channels + pass->lanes - 1) / pass->lanes);
    const long steps = (long)blocks * places / (step * step), most = steps / PART_STEPS;
    const long parts = GROUPS_WANTED / (tiles * step * step), fit = parts < most ? parts : most;
    pass->parts = fit < 2 ? 1 : fit > PARTS_MOST ? PARTS_MOST : (int)fit;
}

/* Winograd pays from so many channels on, on vector units (perf/results/conv-cpu.md): fewer leave its transforms
 * without products to save. Its transformed weights are four times larger, so small images pay more for reading them
 * than they save. Whether it serves depends on one image alone: results do not change with the batch. */
#define WINOGRAD_CHANNELS        16
#define WINOGRAD_PIXELS          144
#define WINOGRAD_GRADIENT_PIXELS 256

static int winograd_pays(const hada_context *context, int in_channels, int out_channels)
{
    return context->info.kind == HADA_DEVICE_CPU && context->shape == HADA_SHAPE_LANES &&
           in_channels >= WINOGRAD_CHANNELS && out_channels >= WINOGRAD_CHANNELS;
}

static int is_winograd_quicker(const hada_context *context, hada_conv_method method, const hada_conv_pass *pass)
{
    const int pays = winograd_pays(context, pass->in_channels, pass->out_channels) &&
                     pass->out_rows * pass->out_cols >= WINOGRAD_PIXELS;
    return pass->out_rows >= TILE && pass->out_cols >= TILE &&
           (method == HADA_CONV_WINOGRAD4 || (method == HADA_CONV_AUTO && pays));
}

static int is_gradient_winograd_quicker(const hada_context *context, hada_conv_method method,
                                        const hada_conv_gradient *gradient)
{
    const int pays = winograd_pays(context, gradient->fine_channels, gradient->coarse_channels) &&
                     gradient->coarse_rows * gradient->coarse_cols >= WINOGRAD_GRADIENT_PIXELS;
    return gradient->coarse_rows >= TILE && gradient->coarse_cols >= TILE &&
           (method == HADA_CONV_WINOGRAD4 || (method == HADA_CONV_AUTO && pays));
}

static int tiles_at_once(int block, int three_launches)
{
    return block != 16 ? 6 : three_launches ? 8 : 12;
}

static int tiles_fit(const hada_context *context, const hada_conv_pass *pass, int blocks, int tiles)
{
    const int block = hada_net_block(context);
    const size_t in_blocks = (size_t)((pass->in_channels + block - 1) / block);
    const size_t each = PLACES * (in_blocks + (size_t)blocks) * (size_t)block * sizeof(float);
    return (size_t)tiles <= local_borne(context) / each;
}

static void choose_tiles(const hada_context *context, hada_conv_pass *pass)
{
    const int block = hada_net_block(context), step = tiles_at_once(block, 0);
    const int out_blocks = (pass->out_channels + block - 1) / block, blocks = out_blocks % 2 ? 1 : 2;
    pass->lanes = blocks * block;
    /* beyond so many channels the weights come from outside the caches for each group of tiles */
    if (!tiles_fit(context, pass, blocks, step) || pass->in_channels > 12 * block)
        pass->tiles = 0;
    else /* a work-item shares its cache with others' weights */
        pass->tiles = tiles_fit(context, pass, blocks, 4 * step) ? 2 * step : step;
}

static void choose_gradient_tiles(const hada_context *context, hada_conv_gradient *gradient)
{
    const int block = hada_net_block(context), coarse = (gradient->coarse_channels + block - 1) / block * block;
    const int fine = (gradient->fine_channels + block - 1) / block * block;
    const size_t tiles = local_borne(context) / ((size_t)(PLACES * (coarse + fine + 2)) * sizeof(float));
    gradient->blocks = coarse / block % 2 ? 1 : 2;
    gradient->fine_each = gradient->blocks == 1 ? block : block / 2;
    /* more transformed gradients than this fall out of the caches from one group of tiles to the next */
    gradient->tiles = coarse * fine > 64 * 64 || tiles < 12 ? 0 : tiles > 48 ? 48 : (int)tiles;
}

/* One row serves a kernel of 3 columns, the other any kernel; few fine channels take all rows of a 3 x 3 kernel at
 * once. */
static void choose_gradient(const hada_context *context, const hada_conv_desc *desc, hada_conv_gradient *gradient)
{
    const int block = hada_net_block(context), blocks = (gradient->coarse_channels + block - 1) / block;
    const int fine = gradient->fine_channels, three = desc->kernel_cols == 3;
    gradient->blocks = blocks % 2 ? 1 : 2;
    gradient->cols_each = three ? 3 : 1;
    gradient->rows_each = 1;
    if (!three) {
        gradient->fine_each = block / 2;
    } else if (desc->kernel_rows == 3 && (fine == 1 || (fine == 3 && block == 16))) {
        gradient->rows_each = 3;
        gradient->fine_each = fine;
        gradient->blocks = 1;
    } else {
        gradient->fine_each = block / 4 * (gradient->blocks == 1 && fine > block / 4 ? 2 : 1);
    }
}

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

/* Whether Winograd's tiles fit the shape at all. */
static int has_winograd_shape(const hada_conv_plan *plan)
{
    const hada_conv_desc *d = &plan->desc;
    return d->kernel_rows == 3 && d->kernel_cols == 3 && d->stride == 1 && d->pad_rows == 1 && d->pad_cols == 1 &&
           !d->output_pad && !plan->groups;
}

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
static void plan_winograd(hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass)
{
    const size_t places = PLACES;
    const size_t in = (size_t)padded(pass->in_channels, plan->block);
    const size_t out = (size_t)padded(pass->out_channels, plan->block);
    const size_t across = (size_t)padded(pass->out_cols, TILE) / TILE;
    const size_t all = across * (size_t)(padded(pass->out_rows, TILE) / TILE);
    pass->method = HADA_CONV_WINOGRAD4;
    choose_tiles(context, pass);
    pass->weight_floats = places * in * out;
    pass->pixels = tiles_at_once(plan->block, 0);
    /* sums of twice the tiles find room in 32 registers, where there is one block of outputs */
    if (plan->block == 16 && pass->lanes == plan->block && pass->tiles % (2 * pass->pixels) == 0)
        pass->pixels *= 2;
    if (pass->tiles && (size_t)pass->tiles <= all)
        return;
    pass->pixels = tiles_at_once(plan->block, 1);
    const size_t floats = places * (in + out), step = (size_t)pass->pixels;
    const size_t most = STEP_FLOATS / floats / step * step, wanted = all * (size_t)plan->desc.images;
    const size_t room = most < step ? step : most < wanted ? most : (wanted + step - 1) / step * step;
    pass->tiles = 0;
    pass->room = (int)room;
    pass->scratch_floats = floats * room + places * 2 * (size_t)plan->block;
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

/* Tiles of registers or, in work-groups, of local memory. */
static void plan_direct(const hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass)
{
    choose_direct(context, pass);
    if (plan->groups)
        choose_group(context, pass, plan->desc.kernel_rows * plan->desc.kernel_cols);
    if (plan->desc.method == HADA_CONV_DIRECT)
        pass->parts = 1; /* tiles of an image hold the bits of the whole (net/enhance.c) */
    if (plan->groups || !pass->lanes || pass->in_step > 1 || pass->step > 1)
        return;
    const int taps = plan->desc.kernel_rows * plan->desc.kernel_cols;
    choose_few(context, pass, taps);
    if (!pass->few)
        choose_flat(context, pass, taps);
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

static void plan_pass(hada_conv_plan *plan, const hada_context *context, hada_conv_pass *pass, int to_coarse)
{
    const hada_conv_method wanted = plan->desc.method;
    *pass = sizes_of(&plan->desc, to_coarse);
    const int near = is_near(&plan->desc, pass);
    pass->method = plan->groups && wanted == HADA_CONV_TF32 ? HADA_CONV_TF32 : HADA_CONV_DIRECT;
    plan_direct(plan, context, pass);
    if (plan->groups && wanted == HADA_CONV_AUTO && is_tf32_quicker(context, pass))
        pass->method = HADA_CONV_TF32;
    if (!near || !pass->lanes || wanted == HADA_CONV_PLAIN)
        pass->method = HADA_CONV_PLAIN;
    pass->winograd = has_winograd_shape(plan) && is_winograd_quicker(context, wanted, pass);
    if (pass->winograd) {
        plan_winograd(plan, context, pass);
        return;
    }
    pass->weight_floats = direct_weight_floats(plan, pass);
    if (plan->groups && pass->method != HADA_CONV_PLAIN)
        plan_parts(plan, pass);
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
    choose_gradient_tiles(context, g);
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
    choose_gradient(context, d, g);
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
    g->winograd = has_winograd_shape(plan) && is_gradient_winograd_quicker(context, d->method, g);
    if (g->winograd) {
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
    if (pass->winograd && pass->tiles)
        return hada_find_conv_winograd(.net_block = block, .conv_blocks = blocks, .conv_pixels = pass->pixels);
    if (pass->winograd)
        return hada_find_conv_winograd_steps(.net_block = block, .conv_blocks = blocks, .conv_pixels = pass->pixels);
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
    if (g->winograd && g->tiles)
        return hada_find_conv_winograd_weights(.net_block = plan->block, .conv_blocks = g->blocks,
                                               .conv_fine = g->fine_each);
    if (g->winograd)
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
                        d->in_cols % 2 == 0 && !d->training && plan->pass[HADA_CONV_FORWARD].winograd))
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "a convolution that doubles %d of %d channels of %dx%d pixels: resize them first", d->doubled,
                     d->in_channels, d->in_rows, d->in_cols);
}

hada_status hada_conv_plan_make(hada_conv_plan *plan, const hada_context *context, const hada_conv_desc *desc,
                                hada_error *err)
{
    *plan = (hada_conv_plan){.desc = *desc,
                             .block = hada_net_block(context),
                             .groups = context->shape == HADA_SHAPE_GROUPS,
                             .pass_count = desc->training ? HADA_CONV_PASSES : 1};
    plan_pass(plan, context, &plan->pass[HADA_CONV_FORWARD], !desc->transposed);
    if (desc->training) {
        plan_pass(plan, context, &plan->pass[HADA_CONV_DATA], desc->transposed);
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
