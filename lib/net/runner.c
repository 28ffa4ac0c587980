/* A net made ready for images of one size: the public way of running one. */

#include "core/callers.h"
#include "image/pixels.h"
#include "net/graph.h"
#include "runtime/memory.h"

struct hada_net_runner {
    hada_slot *slot;
    hada_graph *graph;
    hada_buffer values, in, out;
    hada_planar from, to;
    int channels, rows, cols;             /* of the input */
    int out_channels, out_rows, out_cols; /* of the output */
};

static size_t image_bytes(int channels, int rows, int cols)
{
    return (size_t)channels * (size_t)rows * (size_t)cols * sizeof(float);
}

static hada_status make(hada_net_runner *runner, hada_context *context, const hada_net *net, hada_error *err)
{
    const hada_graph_options options = {.images = 1, .rows = runner->rows, .cols = runner->cols};
    HADA_TRY(hada_slot_create(&runner->slot, context, err));
    HADA_TRY(hada_graph_create(&runner->graph, runner->slot, net, &options, err));
    HADA_TRY(hada_buffer_create_from(&runner->values, runner->slot, net->values, net->floats * sizeof(float),
                                     "the net's weights", err));
    HADA_TRY(hada_buffer_create(&runner->in, context, image_bytes(runner->channels, runner->rows, runner->cols),
                                "the net's input", err));
    HADA_TRY(hada_buffer_create(&runner->out, context,
                                image_bytes(runner->out_channels, runner->out_rows, runner->out_cols),
                                "the net's output", err));
    HADA_TRY(hada_graph_set_weights(runner->graph, (hada_floats){runner->values.mem, 0}, err));
    runner->from = hada_planar_at(runner->in.mem, 0, runner->channels, runner->rows, runner->cols);
    runner->to = hada_planar_at(runner->out.mem, 0, runner->out_channels, runner->out_rows, runner->out_cols);
    return HADA_OK;
}

hada_status hada_net_runner_create(hada_net_runner **out, hada_context *context, const hada_net *net, int rows,
                                   int cols, hada_error *err)
{
    hada_status status = HADA_OK;
    hada_net_runner *runner = NULL;
    hada_size size;
    HADA_NEED(out && context && net, err);
    *out = NULL;
    const hada_net_info *info = hada_net_get_info(net);
    HADA_TRY_OR_DONE(hada_net_output_size(net, rows, cols, &size, err));
    HADA_TRY_OR_DONE(HADA_NEW(runner, 1, "a net", err));
    *runner = (hada_net_runner){.channels = info->channels,
                                .rows = rows,
                                .cols = cols,
                                .out_channels = info->out_channels,
                                .out_rows = size.rows,
                                .out_cols = size.cols};
    HADA_TRY_OR_DONE(make(runner, context, net, err));
done:
    if (status)
        hada_net_runner_destroy(&runner);
    *out = runner;
    return status;
}

void hada_net_runner_destroy(hada_net_runner **pointer)
{
    hada_net_runner *runner = hada_taken(pointer);
    if (!runner)
        return;
    if (runner->slot)
        hada_slot_finish(runner->slot, NULL);
    hada_graph_destroy(&runner->graph);
    HADA_DESTROY_BUFFERS(&runner->values, &runner->in, &runner->out);
    hada_slot_destroy(&runner->slot);
    free(runner);
}

hada_status hada_net_bytes(hada_context *context, const hada_net *net, int rows, int cols, uint64_t *bytes,
                           hada_error *err)
{
    hada_dry dry;
    hada_net_runner *runner;
    HADA_NEED(context && net && bytes, err);
    hada_dry_begin(&dry, context);
    const hada_status status = hada_net_runner_create(&runner, &dry.context, net, rows, cols, err);
    *bytes = hada_context_bytes(&dry.context);
    hada_net_runner_destroy(&runner);
    hada_dry_end(&dry);
    return status;
}

hada_status hada_net_run(hada_net_runner *runner, const hada_image *in, hada_image *out, hada_error *err)
{
    HADA_NEED(runner && out, err);
    HADA_NEED_IMAGE(in, NULL, err);
    if (in->channels != runner->channels || in->rows != runner->rows || in->cols != runner->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the image has %d channel(s) of %d x %d pixels; the net was made ready for %d of %d x %d",
                         in->channels, in->rows, in->cols, runner->channels, runner->rows, runner->cols);
    HADA_TRY(hada_buffer_write(&runner->in, runner->slot, 0, in->data, runner->in.bytes, err));
    HADA_TRY(hada_image_ensure(out, runner->out_channels, runner->out_rows, runner->out_cols, err));
    HADA_TRY(hada_graph_load(runner->graph, &runner->from, err));
    HADA_TRY(hada_graph_forward(runner->graph, err));
    HADA_TRY(hada_graph_store(runner->graph, &runner->to, err));
    return hada_buffer_read(&runner->out, runner->slot, 0, out->data, runner->out.bytes, err);
}
