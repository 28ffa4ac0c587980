#include "net/conv_variants.h"

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
    if (plan->groups) { /* work-groups have one kernel without options */
        add(&all, (hada_conv_choice){HADA_CONV_DIRECT, -1, -1, -1, -1});
        return all.count;
    }
    add_direct(&all, -1);
    add_winograd(&all);
    add_direct(&all, 1);
    add_direct(&all, 4);
    add_direct(&all, 16);
    return all.count;
}
