/* Choices for convolutions: the words of a pass in the tuning file, whether a choice can serve it, and what a tuner may
 * try. A shape is
 * KERNELxKERNEL/STEP OF THE INPUT/STEP OF THE OUTPUT+PADDING:CHANNELS>CHANNELS:ROWSxCOLS of the output: a convolution
 * with stride 2 is 3x3/2/1, a transposed one 2x2/1/2; a gradient of the input is a pass as any other. The padding is
 * that of the transposed pass: 1 for 3 x 3 kernels that keep the size. */
#include <stdio.h>
#include <string.h>

#include "net/conv_internal.h"

static const char *const methods[] = {"auto", "direct", "winograd2", "winograd4", "plain", "tf32"};

static void shape_text(const hada_conv_desc *d, const hada_conv_pass *pass, char *text, size_t size)
{
    snprintf(text, size, "%dx%d/%d/%d+%d:%d>%d:%dx%d", d->kernel_rows, d->kernel_cols, pass->in_step, pass->step,
             pass->taps_rows, pass->in_channels, pass->out_channels, pass->out_rows, pass->out_cols);
}

void hada_conv_shape_text(const hada_conv_plan *plan, int pass, char *text, size_t size)
{
    shape_text(&plan->desc, &plan->pass[pass], text, size);
}

void hada_conv_choice_text(const hada_conv_plan *plan, int index, char *text, size_t size)
{
    const hada_conv_pass *pass = &plan->pass[index];
    const int block = plan->block, blocks = pass->lanes / block;
    if (pass->method == HADA_CONV_PLAIN || plan->groups)
        snprintf(text, size, "%s", methods[pass->method]);
    else if (pass->method == HADA_CONV_DIRECT && pass->flat)
        snprintf(text, size, "direct block=%d", block);
    else if (pass->method == HADA_CONV_DIRECT && pass->few)
        snprintf(text, size, "direct block=%d rows=%d", block, pass->rows_each);
    else if (pass->method == HADA_CONV_DIRECT)
        snprintf(text, size, "direct block=%d blocks=%d pixels=%d rows=%d", block, blocks, pass->pixels,
                 pass->rows_each);
    else
        snprintf(text, size, "%s block=%d blocks=%d tiles=%d", methods[pass->method], block, blocks, pass->tiles);
}

hada_status hada_conv_choice_find(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                  hada_conv_choice *choice, const hada_tuning_row **row, hada_error *err)
{
    char shape[HADA_TUNING_WORD];
    if (!context->tuning)
        return HADA_OK;
    shape_text(&plan->desc, pass, shape, sizeof shape);
    *row = hada_tuning_find(context, "conv", shape, plan->block);
    if (!*row)
        return HADA_OK;
    const int *options = (*row)->options;
    for (int m = HADA_CONV_DIRECT; m < HADA_CONV_METHODS; m++)
        if (!strcmp((*row)->choice, methods[m]))
            choice->method = (hada_conv_method)m;
    choice->blocks = options[HADA_TUNING_BLOCKS];
    choice->pixels = options[HADA_TUNING_PIXELS];
    choice->rows = options[HADA_TUNING_ROWS];
    choice->tiles = options[HADA_TUNING_TILES];
    const int direct = choice->method == HADA_CONV_DIRECT;
    const int winograd = choice->method == HADA_CONV_WINOGRAD2 || choice->method == HADA_CONV_WINOGRAD4;
    if ((!direct && (choice->pixels >= 0 || choice->rows >= 0)) || (!winograd && choice->tiles >= 0) ||
        (!direct && !winograd && choice->blocks >= 0))
        return hada_tuning_refuse(context, *row, "pixels and rows are for direct, tiles for winograd, blocks for both",
                                  err);
    if (!choice->blocks || !choice->pixels || !choice->rows)
        return hada_tuning_refuse(context, *row, "blocks, pixels and rows are numbers from 1 on", err);
    return HADA_OK;
}

static const char *direct_misfit(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                 int near, const hada_conv_choice *choice)
{
    if (!near)
        return "direct convolutions read at most one pixel beyond the image";
    if (plan->groups)
        return choice->blocks > 0 || choice->pixels > 0 || choice->rows > 0
                   ? "direct convolutions in work-groups have no options"
                   : NULL;
    if ((choice->blocks > 0) != (choice->pixels > 0))
        return "blocks and pixels of direct convolutions go together";
    if (choice->blocks > 0 && !hada_conv_table_direct(context, pass, choice->blocks, choice->pixels))
        return "no direct kernel has so many blocks and pixels, or they do not fit the shape";
    return NULL;
}

static const char *winograd_misfit(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                   const hada_conv_choice *choice)
{
    hada_conv_pass with = *pass;
    const int out_blocks = (pass->out_channels + plan->block - 1) / plan->block;
    const int blocks = choice->blocks > 0 ? choice->blocks : out_blocks % 2 ? 1 : 2;
    with.tile = choice->method == HADA_CONV_WINOGRAD2 ? 2 : 4;
    if (!hada_conv_is_winograd(plan) || pass->out_rows < with.tile || pass->out_cols < with.tile)
        return "Winograd's convolutions take 3 x 3 kernels with stride 1 and padding 1, on CPUs and accelerators, and "
               "images of a tile at least";
    if (blocks > 2 || out_blocks % blocks)
        return "Winograd's convolutions take one block of output channels or, where their number is even, two";
    if (choice->tiles > 0 && (choice->tiles % hada_conv_table_step(plan->block, 0) ||
                              !hada_conv_table_tiles_fit(context, &with, blocks, choice->tiles)))
        return "Winograd's tiles are multiples of 12 (6 for blocks of 8), as many as local memory holds";
    const int all = ((pass->out_rows + 1) / 2) * ((pass->out_cols + 1) / 2);
    if (with.tile == 2 && (choice->tiles <= 0 || choice->tiles > all))
        return "winograd2 needs tiles, no more than the image has: it is not offered in three launches";
    return NULL;
}

const char *hada_conv_choice_misfit(const hada_context *context, const hada_conv_plan *plan, const hada_conv_pass *pass,
                                    int near, const hada_conv_choice *choice)
{
    switch (choice->method) {
    case HADA_CONV_DIRECT: return direct_misfit(context, plan, pass, near, choice);
    case HADA_CONV_WINOGRAD2:
    case HADA_CONV_WINOGRAD4: return winograd_misfit(context, plan, pass, choice);
    case HADA_CONV_TF32:
        return plan->groups && near ? NULL : "tf32 is for work-groups, and reads at most one pixel beyond the image";
    default: return NULL;
    }
}

/* What a tuner may try. */
typedef struct list {
    const hada_context *context;
    const hada_conv_plan *plan;
    hada_conv_choice *choices;
    int count;
} list;

/* Adds a choice; those that do not fit the shape are refused when they are made. */
static void add(list *all, hada_conv_choice choice)
{
    if (all->count < HADA_CONV_VARIANTS)
        all->choices[all->count++] = choice;
}

static void add_winograd(list *all)
{
    const int block = all->plan->block, step = hada_conv_table_step(block, 0);
    const int blocks = (all->plan->pass[HADA_CONV_FORWARD].out_channels + block - 1) / block;
    const int few = blocks % 2 ? 1 : 2;
    if (!hada_conv_is_winograd(all->plan))
        return;
    for (int b = few; b >= 1; b--)
        for (int tiles = 0; tiles <= 4 * step; tiles += tiles < 2 * step ? step : 2 * step)
            add(all, (hada_conv_choice){HADA_CONV_WINOGRAD4, b, -1, -1, tiles});
    for (int tiles = step; tiles <= 2 * step; tiles += step)
        add(all, (hada_conv_choice){HADA_CONV_WINOGRAD2, few, -1, -1, tiles});
}

/* Every register tile with `rows` of a work-item; -1: the table's. */
static void add_direct(list *all, int rows)
{
    const hada_conv_pass *pass = &all->plan->pass[HADA_CONV_FORWARD];
    int blocks, pixels;
    for (int i = 0; rows <= pass->out_rows && hada_conv_table_direct_at(all->context, pass, i, &blocks, &pixels); i++)
        if (pixels > 1 || pass->out_cols < 8)
            add(all, (hada_conv_choice){HADA_CONV_DIRECT, blocks, pixels, rows, -1});
}

int hada_conv_variants(const hada_context *context, const hada_conv_plan *plan,
                       hada_conv_choice choices[HADA_CONV_VARIANTS])
{
    list all = {context, plan, choices, 0};
    if (plan->groups) { /* kernels of work-groups have no options */
        add(&all, (hada_conv_choice){HADA_CONV_DIRECT, -1, -1, -1, -1});
        if (context->tensor_cores)
            add(&all, (hada_conv_choice){HADA_CONV_TF32, -1, -1, -1, -1});
        return all.count;
    }
    add_direct(&all, -1);
    add_winograd(&all);
    add_direct(&all, 1);
    add_direct(&all, 4);
    add_direct(&all, 16);
    return all.count;
}
