/* Nets run here, for comparison with PyTorch: files of tensors in, files of tensors out.
 *
 *     oracle_net make KIND CHANNELS NET      a net with random weights: paper, compact, discriminator, patch, vgg16, or
 * a U-net's "DOWN/UP[/linear|nearest|transposed[/norm]]" oracle_net vgg16 FILE NET              VGG-16 with the weights
 * of torchvision's file oracle_net forward NET IN OUT          x of IN [images][channels][rows][cols] -> y of OUT
 *     oracle_net backward NET IN OUT [again] x and dy of IN -> y, dx, and "grad." + each parameter of OUT, and the
 *                                            running statistics by their names; "again": with recomputation */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "io/safetensors.h"
#include "net/graph.h"
#include "netlist/presets.h"

static hada_error err;

static void must(hada_status status)
{
    if (!status)
        return;
    fprintf(stderr, "oracle_net: %s: %s\n%s\n", hada_status_name(status), err.message, err.detail);
    exit(1);
}

static hada_net *make(const char *kind, int channels)
{
    hada_net *net;
    char text[256], *part[4] = {NULL, NULL, NULL, NULL};
    hada_unet_options options;
    if (!strcmp(kind, "paper") || !strcmp(kind, "compact")) {
        must(hada_net_create_preset(&net, kind, channels, 1, &err));
        return net;
    }
    if (!strcmp(kind, "discriminator") || !strcmp(kind, "patch") || !strcmp(kind, "vgg16")) {
        must(*kind == 'v' ? hada_vgg16_make(&net, &err)
                          : hada_discriminator_make(&net, *kind == 'p' ? kind : "paper", channels, &err));
        float *before = net->values + (*kind == 'v' ? hada_net_find(net, "normalize.weight")->offset : 0), keep[12];
        memcpy(keep, before, sizeof keep);
        must(hada_net_init(net, 1, &err));
        if (*kind == 'v')
            memcpy(before, keep, sizeof keep);
        return net;
    }
    snprintf(text, sizeof text, "%s", kind);
    char *at = text;
    for (int i = 0; i < 4 && at; i++) {
        part[i] = at;
        at = strchr(at, '/');
        if (at)
            *at++ = '\0';
    }
    hada_unet_options_init(&options);
    options.channels = options.out_channels = channels;
    options.down = part[0];
    options.up = part[1] ? part[1] : "";
    options.up_by = part[2] && *part[2] == 't'   ? HADA_UNET_TRANSPOSED
                    : part[2] && *part[2] == 'n' ? HADA_UNET_NEAREST
                                                 : HADA_UNET_LINEAR;
    if (part[3]) {
        options.shared = options.last_norm = options.last_relu = 1;
        options.last_kernel = 3;
    }
    must(hada_net_create_unet(&net, &options, 1, &err));
    return net;
}

typedef struct image_set {
    int64_t shape[4];
    size_t count;
    float *data;
} image_set;

static image_set make_set(int64_t images, int64_t channels, int64_t rows, int64_t cols)
{
    image_set set = {.shape = {images, channels, rows, cols}};
    set.count = (size_t)(images * channels * rows * cols);
    set.data = malloc(set.count * sizeof(float));
    if (!set.data)
        exit(1);
    return set;
}

static image_set read_set(const hada_tensors *file, const char *name)
{
    const hada_stored_tensor *stored = hada_tensors_find(file, name);
    if (!stored || stored->dims != 4)
        exit(2);
    image_set set = make_set(stored->shape[0], stored->shape[1], stored->shape[2], stored->shape[3]);
    must(hada_tensor_copy_f32(stored, 0, set.count, set.data, &err));
    return set;
}

static hada_planar planar_of(const image_set *set, const hada_buffer *buffer)
{
    const size_t plane = (size_t)(set->shape[2] * set->shape[3]);
    return (hada_planar){buffer->mem, 0, plane * (size_t)set->shape[1], plane, (size_t)set->shape[3]};
}

static void write_file(const char *path, const hada_net *net, const image_set *sets, const char *const *names,
                       int count, const float *gradients, const float *values)
{
    hada_tensors_writer *writer;
    must(hada_tensors_create(&writer, path, &err));
    for (int i = 0; i < count; i++)
        must(hada_tensors_declare(writer, names[i], HADA_F32, 4, sets[i].shape, &err));
    for (int i = 0; gradients && i < net->parameter_count; i++) {
        const hada_parameter *p = &net->parameters[i];
        char name[128];
        snprintf(name, sizeof name, "%s%s", p->trained ? "grad." : "", p->name);
        must(hada_tensors_declare(writer, name, HADA_F32, p->dims, p->shape, &err));
    }
    for (int i = 0; i < count; i++)
        must(hada_tensors_write(writer, sets[i].data, sets[i].count * sizeof(float), &err));
    for (int i = 0; gradients && i < net->parameter_count; i++) {
        const hada_parameter *p = &net->parameters[i];
        must(hada_tensors_write(writer, (p->trained ? gradients : values) + p->offset, p->count * sizeof(float), &err));
    }
    must(hada_tensors_finish(&writer, &err));
}

int main(int argc, char **argv)
{
    hada_net *net;
    if (argc == 5 && !strcmp(argv[1], "make")) {
        net = make(argv[2], atoi(argv[3]));
        must(hada_net_save(net, argv[4], &err));
        hada_net_destroy(&net);
        return 0;
    }
    if (argc == 4 && !strcmp(argv[1], "vgg16")) {
        must(hada_vgg16_load(&net, argv[2], &err));
        must(hada_net_save(net, argv[3], &err));
        hada_net_destroy(&net);
        return 0;
    }
    if (argc < 5)
        return 2;
    const int backward = !strcmp(argv[1], "backward");
    hada_tensors *in;
    hada_context *context;
    hada_slot *slot;
    hada_graph *graph;
    hada_buffer values, gradients = {0}, from, to;
    must(hada_net_load(&net, argv[2], &err));
    must(hada_tensors_open(&in, argv[3], &err));
    image_set x = read_set(in, "x");
    const hada_graph_options options = {.images = (int)x.shape[0],
                                        .rows = (int)x.shape[2],
                                        .cols = (int)x.shape[3],
                                        .training = backward,
                                        .weight_gradients = backward,
                                        .input_gradient = backward,
                                        .recompute = argc > 5};
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    size_t stated;
    must(hada_graph_bytes(context, net, &options, &stated, &err));
    const uint64_t before = hada_context_bytes(context);
    must(hada_graph_create(&graph, slot, net, &options, &err));
    if (hada_context_bytes(context) - before != stated) {
        fprintf(stderr, "stated %zu bytes, held %llu\n", stated,
                (unsigned long long)(hada_context_bytes(context) - before));
        return 3;
    }
    must(hada_buffer_create_from(&values, slot, net->values, net->floats * sizeof(float), "weights", &err));
    must(hada_buffer_create_from(&from, slot, x.data, x.count * sizeof(float), "x", &err));
    must(hada_graph_set_weights(graph, (hada_floats){values.mem, 0}, &err));
    const hada_planar in_planes = planar_of(&x, &from);
    must(hada_graph_load(graph, &in_planes, &err));
    must(hada_graph_forward(graph, &err));
    const hada_tensor *out = hada_graph_output(graph);
    image_set sets[2] = {make_set(x.shape[0], (int64_t)out->channels * net->colours, out->rows, out->cols), x};
    const hada_planar out_planes = planar_of(&sets[0], &from);
    must(hada_buffer_create(&to, context, sets[0].count * sizeof(float), "y", &err));
    hada_planar planes = out_planes;
    planes.mem = to.mem;
    must(hada_graph_store(graph, &planes, &err));
    must(hada_buffer_read(&to, slot, 0, sets[0].data, sets[0].count * sizeof(float), &err));
    float *host = NULL;
    if (backward) {
        image_set dy = read_set(in, "dy");
        must(hada_buffer_create(&gradients, context, net->trained * sizeof(float), "gradients", &err));
        must(hada_buffer_write(&to, slot, 0, dy.data, dy.count * sizeof(float), &err));
        must(hada_graph_load_gradient(graph, &planes, &err));
        must(hada_graph_backward(graph, (hada_floats){gradients.mem, 0}, 0, &err));
        must(hada_graph_store_gradient(graph, &in_planes, &err));
        must(hada_buffer_read(&from, slot, 0, x.data, x.count * sizeof(float), &err));
        host = malloc((net->trained + 1) * sizeof(float));
        must(hada_buffer_read(&gradients, slot, 0, host, net->trained * sizeof(float), &err));
        must(hada_buffer_read(&values, slot, 0, net->values, net->floats * sizeof(float), &err));
        free(dy.data);
    }
    const char *const names[2] = {"y", "dx"};
    write_file(argv[4], net, sets, names, backward ? 2 : 1, host, net->values);
    hada_graph_destroy(&graph);
    hada_buffer_destroy(&values);
    hada_buffer_destroy(&gradients);
    hada_buffer_destroy(&from);
    hada_buffer_destroy(&to);
    hada_slot_destroy(&slot);
    if (hada_context_bytes(context))
        return 4;
    hada_context_destroy(&context);
    hada_tensors_close(&in);
    hada_net_destroy(&net);
    free(host);
    free(sets[0].data);
    free(x.data);
    return 0;
}
