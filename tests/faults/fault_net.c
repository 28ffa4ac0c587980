/* Nets: lists and their files, a model that holds one, a training step, a plane in tiles. */
#include "fault_job.h"
#include "net/enhance.h"

static hada_status make_net(const fault_job *job, hada_net **net, hada_error *err)
{
    DEFAULTS(hada_unet_options, options);
    options.channels = options.out_channels = hada_model_get_info(job->model)->channels;
    options.down = "4|5";
    options.up = "4";
    options.shared = options.last_norm = 1;
    return hada_net_create_unet(net, &options, 1, err);
}

/* To a file and back, by itself and in a model; `with` is the model with the net. */
static hada_status files(fault_job *job, const hada_net *net, hada_model **with, hada_error *err)
{
    char path[200];
    SCOPED(hada_net) *back = NULL;
    SCOPED(hada_model) *model = NULL;
    snprintf(path, sizeof path, "%s/net.model", job->folder);
    HADA_TRY(hada_net_save(net, path, err));
    HADA_TRY(hada_net_load(&back, path, err));
    fault_add(job, back->values, back->floats * sizeof(float));
    HADA_TRY(hada_model_with_enhance(&model, job->model, back, 16, 18, err));
    HADA_TRY(hada_model_save(model, path, err));
    return hada_model_load(with, path, err);
}

static hada_status run_step(fault_job *job, const hada_net *net, hada_slot *slot, hada_graph *graph,
                            hada_buffer *values, hada_buffer *gradients, hada_error *err)
{
    SCOPED_MEMORY float *host = calloc(net->trained, sizeof *host);
    if (!host)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the gradients");
    const hada_tensor *x = hada_graph_input(graph);
    /* the weights are used as an image and as the gradient of the output */
    const hada_planar image = {values->mem, 0, 0, 0, (size_t)x->cols};
    HADA_TRY(hada_graph_set_weights(graph, (hada_floats){values->mem, 0}, err));
    HADA_TRY(hada_graph_load(graph, &image, err));
    HADA_TRY(hada_graph_forward(graph, err));
    HADA_TRY(hada_graph_load_gradient(graph, &image, err));
    HADA_TRY(hada_graph_backward(graph, (hada_floats){gradients->mem, 0}, 0, err));
    HADA_TRY(hada_buffer_read(gradients, slot, 0, host, net->trained * sizeof *host, err));
    fault_add(job, host, net->trained * sizeof *host);
    return HADA_OK;
}

static hada_status train(fault_job *job, const hada_net *net, hada_error *err)
{
    const hada_graph_options options = {
        .images = 1, .rows = 9, .cols = 10, .training = 1, .weight_gradients = 1, .input_gradient = 1, .recompute = 1};
    hada_slot *slot = NULL;
    hada_graph *graph = NULL;
    hada_buffer values = {0}, gradients = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, job->context, err));
    HADA_TRY_OR_DONE(hada_graph_create(&graph, slot, net, &options, err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&values, slot, net->values, net->floats * sizeof(float), "weights", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&gradients, job->context, net->trained * sizeof(float), "gradients", err));
    HADA_TRY_OR_DONE(run_step(job, net, slot, graph, &values, &gradients, err));
done:
    if (slot)
        hada_slot_finish(slot, NULL);
    hada_graph_destroy(&graph);
    HADA_DESTROY_BUFFERS(&values, &gradients);
    hada_slot_destroy(&slot);
    return status;
}

/* A plane through the net in tiles. */
static hada_status enhance(fault_job *job, const hada_model *with, hada_error *err)
{
    enum { ROWS = 40, COLS = 44 };
    const int channels = hada_model_get_info(with)->channels;
    const hada_enhance_desc desc = {
        .net = hada_model_get_enhance(with), .channels = channels, .rows = ROWS, .cols = COLS, .tile_rows = 2};
    const size_t count = (size_t)channels * ROWS * COLS;
    hada_slot *slot = NULL;
    hada_enhance *enhance = NULL;
    hada_buffer planes = {0};
    hada_image image;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(&image, channels, ROWS, COLS, err));
    for (size_t i = 0; i < count; i++)
        image.data[i] = (float)(i % 7);
    HADA_TRY_OR_DONE(hada_slot_create(&slot, job->context, err));
    HADA_TRY_OR_DONE(hada_enhance_create(&enhance, slot, &desc, err));
    HADA_TRY_OR_DONE(hada_buffer_create_from(&planes, slot, image.data, count * sizeof(float), "planes", err));
    HADA_TRY_OR_DONE(hada_enhance_run(enhance, planes.mem, 0, 1, 1, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&planes, slot, 0, image.data, count * sizeof(float), err));
    fault_add(job, image.data, count * sizeof(float));
done:
    if (slot)
        hada_slot_finish(slot, NULL);
    hada_enhance_destroy(&enhance);
    hada_buffer_destroy(&planes);
    hada_slot_destroy(&slot);
    hada_image_destroy(&image);
    return status;
}

hada_status fault_stage_net(fault_job *job, hada_error *err)
{
    SCOPED(hada_net) *net = NULL;
    SCOPED(hada_model) *with = NULL;
    HADA_TRY(make_net(job, &net, err));
    HADA_TRY(files(job, net, &with, err));
    HADA_TRY(train(job, net, err));
    return enhance(job, with, err);
}
