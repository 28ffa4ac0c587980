/* The convolutions of a net, each once, and their choices in a tuning file. */
#include <hadalens/tune.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "net/conv_internal.h"
#include "net/conv_tune.h"
#include "netlist/net_list.h"

static int same(const hada_tune_conv_row *a, const hada_tune_conv_row *b)
{
    return a->in_channels == b->in_channels && a->out_channels == b->out_channels && a->in_rows == b->in_rows &&
           a->in_cols == b->in_cols && a->kernel == b->kernel && a->stride == b->stride && a->pad == b->pad &&
           a->transposed == b->transposed && a->output_pad == b->output_pad;
}

static hada_status name_of(const hada_context *context, hada_tune_conv_row *row, hada_error *err)
{
    const hada_conv_desc desc = hada_tune_conv_desc(row);
    hada_conv_plan plan;
    hada_status status = hada_conv_plan_make(&plan, context, &desc, NULL, err);
    if (status)
        return status;
    hada_conv_shape_text(&plan, HADA_CONV_FORWARD, row->shape, sizeof row->shape);
    hada_conv_choice_text(&plan, HADA_CONV_FORWARD, row->before, sizeof row->before);
    return HADA_OK;
}

static hada_tune_conv_row row_of(const hada_net *net, const hada_layer *layer, const hada_size *sizes)
{
    const int from = layer->inputs[0];
    return (hada_tune_conv_row){.in_channels = net->layers[from].channels,
                                .out_channels = layer->channels,
                                .in_rows = sizes[from].rows,
                                .in_cols = sizes[from].cols,
                                .kernel = layer->kernel,
                                .stride = layer->stride,
                                .pad = layer->pad,
                                .transposed = layer->transposed,
                                .output_pad = layer->output_pad,
                                .layers = 1};
}

hada_status hada_tune_net(hada_context *context, const hada_net *net, int rows, int cols, hada_tune_conv_row **out,
                          size_t *count, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!context || !net || !out || !count)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "hada_tune_net: a context, a net and places for the rows are needed");
    hada_size *sizes = NULL;
    hada_tune_conv_row *all = NULL;
    *out = NULL;
    *count = 0;
    HADA_TRY_OR_DONE(hada_allocated(sizes = hada_alloc((size_t)net->count, sizeof *sizes, "the sizes of a net", err)));
    HADA_TRY_OR_DONE(
        hada_allocated(all = hada_alloc((size_t)net->count, sizeof *all, "the convolutions of a net", err)));
    HADA_TRY_OR_DONE(hada_net_sizes(net, rows, cols, sizes, err));
    size_t n = 0;
    for (int i = 1; i < net->count; i++) {
        const hada_layer *layer = &net->layers[i];
        if (layer->kind != HADA_LAYER_CONV)
            continue;
        all[n] = row_of(net, layer, sizes);
        size_t k = 0;
        while (k < n && !same(&all[k], &all[n]))
            k++;
        if (k < n) {
            all[k].layers++;
        } else {
            HADA_TRY_OR_DONE(name_of(context, &all[n], err));
            n++;
        }
    }
    *out = all;
    *count = n;
    all = NULL;
done:
    free(sizes);
    free(all);
    return status;
}

hada_status hada_tune_save_convs(const hada_context *context, const char *path, const hada_tune_conv_row *rows,
                                 size_t count, hada_error *err)
{
    hada_status status = HADA_OK;
    const char **words = NULL;
    if (!context || !path || !*path || (count && !rows))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_tune_save_convs: a context, a file name and rows are needed");
    HADA_TRY_OR_DONE(
        hada_allocated(words = hada_alloc(2 * count + 1, sizeof *words, "the rows of a tuning file", err)));
    for (size_t i = 0; i < count; i++) {
        words[i] = rows[i].shape;
        words[count + i] = rows[i].chosen;
    }
    HADA_TRY_OR_DONE(hada_tuning_write(context, path, "conv", words, words + count, count, err));
done:
    free(words);
    return status;
}

void hada_tune_convs_destroy(hada_tune_conv_row **rows)
{
    if (!rows)
        return;
    free(*rows);
    *rows = NULL;
}
