/* Which implementation and which tile sizes serve a shape: read, never timed, during a run. */
#include "net/conv_internal.h"

#include "core/alloc.h"

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

void hada_conv_table_flat(const hada_context *context, hada_conv_pass *pass, int taps)
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

int hada_conv_table_direct_at(const hada_context *context, const hada_conv_pass *pass, int index, int *blocks,
                              int *pixels)
{
    const int block = hada_net_block(context);
    for (size_t i = 0; i < sizeof tile_rows / sizeof *tile_rows; i++)
        if (tile_fits(&tile_rows[i], block, pass) && index-- == 0) {
            *blocks = tile_rows[i].blocks;
            *pixels = tile_rows[i].pixels;
            return 1;
        }
    return 0;
}

int hada_conv_table_direct(const hada_context *context, const hada_conv_pass *pass, int blocks, int pixels)
{
    int b, p;
    for (int i = 0; hada_conv_table_direct_at(context, pass, i, &b, &p); i++)
        if (b == blocks && p == pixels)
            return 1;
    return 0;
}

void hada_conv_table_pass(const hada_context *context, hada_conv_pass *pass)
{
    const int block = hada_net_block(context);
    const tile_row *best = NULL;
    for (size_t i = 0; i < sizeof tile_rows / sizeof *tile_rows; i++)
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

void hada_conv_table_few(const hada_context *context, hada_conv_pass *pass, int taps)
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

int hada_conv_table_tf32(const hada_context *context, const hada_conv_pass *pass)
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

void hada_conv_table_group(const hada_context *context, hada_conv_pass *pass, int places)
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

int hada_conv_table_winograd(const hada_context *context, const hada_conv_desc *desc, const hada_conv_pass *pass)
{
    int tile = desc->method == HADA_CONV_WINOGRAD2 ? 2 : desc->method == HADA_CONV_WINOGRAD4 ? 4 : 0;
    if (desc->method == HADA_CONV_AUTO && winograd_pays(context, pass->in_channels, pass->out_channels) &&
        pass->out_rows * pass->out_cols >= WINOGRAD_PIXELS)
        tile = 4;
    return pass->out_rows < tile || pass->out_cols < tile ? 0 : tile;
}

int hada_conv_table_gradient_winograd(const hada_context *context, const hada_conv_desc *desc,
                                      const hada_conv_gradient *gradient)
{
    const int pays = winograd_pays(context, gradient->fine_channels, gradient->coarse_channels) &&
                     gradient->coarse_rows * gradient->coarse_cols >= WINOGRAD_GRADIENT_PIXELS;
    if (gradient->coarse_rows < 4 || gradient->coarse_cols < 4)
        return 0;
    return desc->method == HADA_CONV_WINOGRAD4 || (desc->method == HADA_CONV_AUTO && pays) ? 4 : 0;
}

int hada_conv_table_step(int block, int three_launches)
{
    return block != 16 ? 6 : three_launches ? 8 : 12;
}

int hada_conv_table_tiles_fit(const hada_context *context, const hada_conv_pass *pass, int blocks, int tiles)
{
    const int block = hada_net_block(context), reach = pass->tile + 2;
    const size_t in_blocks = (size_t)((pass->in_channels + block - 1) / block);
    const size_t each = (size_t)(reach * reach) * (in_blocks + (size_t)blocks) * (size_t)block * sizeof(float);
    return (size_t)tiles <= local_borne(context) / each;
}

void hada_conv_table_tiles(const hada_context *context, hada_conv_pass *pass)
{
    const int block = hada_net_block(context), step = hada_conv_table_step(block, 0);
    const int out_blocks = (pass->out_channels + block - 1) / block, blocks = out_blocks % 2 ? 1 : 2;
    pass->lanes = blocks * block;
    /* beyond so many channels the weights come from outside the caches for each group of tiles */
    if (!hada_conv_table_tiles_fit(context, pass, blocks, step) || pass->in_channels > 12 * block)
        pass->tiles = 0;
    else /* a work-item shares its cache with others' weights */
        pass->tiles = hada_conv_table_tiles_fit(context, pass, blocks, 4 * step) ? 2 * step : step;
}

void hada_conv_table_gradient_tiles(const hada_context *context, hada_conv_gradient *gradient)
{
    const int block = hada_net_block(context), coarse = (gradient->coarse_channels + block - 1) / block * block;
    const int fine = (gradient->fine_channels + block - 1) / block * block;
    const size_t tiles = local_borne(context) / ((size_t)(36 * (coarse + fine + 2)) * sizeof(float));
    gradient->blocks = coarse / block % 2 ? 1 : 2;
    gradient->fine_each = gradient->blocks == 1 ? block : block / 2;
    /* more transformed gradients than this fall out of the caches from one group of tiles to the next */
    gradient->tiles = coarse * fine > 64 * 64 || tiles < 12 ? 0 : tiles > 48 ? 48 : (int)tiles;
}

/* One row serves a kernel of 3 columns, the other any kernel; few fine channels take all rows of a 3 x 3 kernel at
 * once.
 */
void hada_conv_table_gradient(const hada_context *context, const hada_conv_desc *desc, hada_conv_gradient *gradient)
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
