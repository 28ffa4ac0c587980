/* Lists of layers: adding, checking, parameters, first values, sizes. */
#include "netlist/net_list.h"

#include <limits.h>

#include "core/random.h"

/* Bounds on what a list read from a file may claim: far above any net in use, and small enough that products of two of
 * them do not overflow. */
#define MOST_LAYERS     4096
#define MOST_CHANNELS   65536
#define MOST_COLOURS    64
#define MOST_PARAMETERS 65536 /* tensors of them */

static const struct {
    int count;
    const char *word[HADA_LAYER_KINDS];
} words[] = {
    [HADA_WORDS_KIND] = {HADA_LAYER_KINDS,
                         {"input", "conv", "activation", "pool", "resize", "concat", "norm", "dropout", "linear"}},
    [HADA_WORDS_ACTIVATION] = {4, {"none", "relu", "leaky_relu", "sigmoid"}},
    [HADA_WORDS_POOL] = {2, {"max", "mean"}},
    [HADA_WORDS_RESIZE] = {5, {"nearest", "linear", "linear_aligned", "cubic", "cubic_aligned"}}};

const char *hada_net_word(hada_net_words list, int number)
{
    return number >= 0 && number < words[list].count ? words[list].word[number] : NULL;
}

int hada_net_word_find(hada_net_words list, const char *word)
{
    for (int i = 0; word && i < words[list].count; i++)
        if (!strcmp(words[list].word[i], word))
            return i;
    return -1;
}

hada_status hada_net_begin(hada_net **out, int colours, hada_error *err)
{
    hada_net *net = NULL;
    *out = NULL;
    if (colours < 1 || colours > MOST_COLOURS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a net shared by %d channels: 1 to %d can be", colours,
                         MOST_COLOURS);
    HADA_TRY(HADA_NEW(net, 1, "a net", err));
    net->colours = colours;
    *out = net;
    return HADA_OK;
}

void hada_net_destroy(hada_net **pointer)
{
    hada_net *net = hada_taken(pointer);
    if (!net)
        return;
    HADA_FREE(net->layers, net->parameters, net->values, net);
}

hada_layer hada_layer_of(hada_layer_kind kind, const char *name, int input)
{
    hada_layer layer = {.kind = kind,
                        .inputs = {input},
                        .input_count = kind != HADA_LAYER_INPUT,
                        .kernel = kind == HADA_LAYER_POOL ? 2 : 3,
                        .stride = kind == HADA_LAYER_POOL ? 2 : 1,
                        .pad = kind == HADA_LAYER_CONV,
                        .bias = 1,
                        .like = -1,
                        .eps = 1e-5f,
                        .momentum = 0.1f,
                        .parameter = -1};
    snprintf(layer.name, sizeof layer.name, "%s", name ? name : "");
    return layer;
}

hada_status hada_net_add(hada_net *net, const hada_layer *layer, int *index, hada_error *err)
{
    if (net->count == MOST_LAYERS)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a net has more than %d layers", MOST_LAYERS);
    HADA_TRY(HADA_GROW(net->layers, (size_t)net->count, 1, "a net", err));
    if (index)
        *index = net->count;
    net->layers[net->count++] = *layer;
    return HADA_OK;
}

static hada_status refuse(const hada_net *net, int index, const char *why, hada_error *err)
{
    const hada_layer *layer = &net->layers[index];
    const char *kind = hada_net_word(HADA_WORDS_KIND, (int)layer->kind);
    return hada_fail(err, HADA_ERROR_MODEL, "layer %d of the net (%s%s%s) %s", index, kind ? kind : "of no known kind",
                     *layer->name ? " " : "", layer->name, why);
}

static int in_range(int value, int least, int most)
{
    return value >= least && value <= most;
}

static hada_status check_inputs(const hada_net *net, int index, hada_error *err)
{
    const hada_layer *layer = &net->layers[index];
    const int wanted = layer->kind == HADA_LAYER_INPUT ? 0 : 1;
    if ((layer->kind == HADA_LAYER_INPUT) != (index == 0))
        return refuse(net, index, "stands where it cannot: layer 0 is the input, and no other one", err);
    if (layer->kind == HADA_LAYER_CONCAT ? !in_range(layer->input_count, 1, HADA_LAYER_INPUTS)
                                         : layer->input_count != wanted)
        return refuse(net, index, "takes another number of layers than it needs", err);
    for (int i = 0; i < layer->input_count; i++)
        if (!in_range(layer->inputs[i], 0, index - 1))
            return refuse(net, index, "takes a layer that does not stand before it", err);
    return HADA_OK;
}

static hada_status check_numbers(const hada_net *net, int index, hada_error *err)
{
    const hada_layer *layer = &net->layers[index];
    const int windows = layer->kind == HADA_LAYER_CONV || layer->kind == HADA_LAYER_POOL;
    const int weighted = layer->kind == HADA_LAYER_CONV || layer->kind == HADA_LAYER_LINEAR;
    if ((weighted || layer->kind == HADA_LAYER_INPUT) && !in_range(layer->channels, 1, MOST_CHANNELS))
        return refuse(net, index, "has no usable number of channels", err);
    if (windows &&
        (!in_range(layer->kernel, 1, HADA_NET_MOST_PIXELS) || !in_range(layer->stride, 1, HADA_NET_MOST_PIXELS)))
        return refuse(net, index, "has no usable kernel or stride", err);
    if (layer->kind == HADA_LAYER_CONV &&
        (!in_range(layer->pad, 0, layer->kernel - 1) || !in_range(layer->output_pad, 0, layer->stride - 1) ||
         (layer->output_pad && !layer->transposed)))
        return refuse(net, index,
                      "has a padding that cannot be: pad is less than the kernel, "
                      "output_pad less than the "
                      "stride and for transposed convolutions",
                      err);
    if (layer->kind == HADA_LAYER_LINEAR && !in_range(layer->in, 1, INT_MAX))
        return refuse(net, index, "says not how many values it takes (\"in\")", err);
    if (layer->kind == HADA_LAYER_RESIZE && (layer->like >= 0 ? layer->like >= index
                                                              : !in_range(layer->rows, 1, HADA_NET_MOST_PIXELS) ||
                                                                    !in_range(layer->cols, 1, HADA_NET_MOST_PIXELS)))
        return refuse(net, index,
                      "says not what size it gives: that of an earlier layer "
                      "(\"like\"), or rows and cols",
                      err);
    if (layer->kind == HADA_LAYER_NORM && !(layer->eps > 0 && layer->momentum >= 0 && layer->momentum <= 1))
        return refuse(net, index, "needs eps above 0 and a momentum from 0 to 1", err);
    if (layer->kind == HADA_LAYER_DROPOUT && !(layer->p >= 0 && layer->p < 1))
        return refuse(net, index, "needs p from 0 to less than 1", err);
    if (!hada_net_word(HADA_WORDS_ACTIVATION, (int)layer->activation) ||
        !hada_net_word(HADA_WORDS_POOL, (int)layer->pool) || !hada_net_word(HADA_WORDS_RESIZE, (int)layer->resize) ||
        !isfinite(layer->slope))
        return refuse(net, index, "has an activation, pooling or resizing that is none", err);
    return HADA_OK;
}

/* Channels of layers that do not say them. */
static void set_channels(hada_net *net, int index)
{
    hada_layer *layer = &net->layers[index];
    if (layer->kind == HADA_LAYER_INPUT || layer->kind == HADA_LAYER_CONV || layer->kind == HADA_LAYER_LINEAR)
        return;
    layer->channels = 0;
    for (int i = 0; i < layer->input_count; i++)
        layer->channels += net->layers[layer->inputs[i]].channels;
}

static hada_status check_used(const hada_net *net, hada_error *err)
{
    unsigned char *used = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(used, (size_t)net->count, "a net", err));
    for (int k = 0; k < net->count; k++)
        for (int n = 0; n < net->layers[k].input_count; n++)
            used[net->layers[k].inputs[n]] = 1;
    for (int i = 0; i < net->count - 1; i++)
        if (!used[i])
            HADA_TRY_OR_DONE(refuse(net, i, "is taken by no other layer; only the last one is the output", err));
done:
    free(used);
    return status;
}

static int parameters_of(const hada_net *net, const hada_layer *layer)
{
    switch (layer->kind) {
    case HADA_LAYER_CONV:
    case HADA_LAYER_LINEAR: return 1 + (layer->bias != 0);
    case HADA_LAYER_NORM: return 4 * net->colours;
    default: return 0;
    }
}

static void add_parameter(hada_net *net, int layer, int colour, const char *what, int dims, const int64_t *shape,
                          int trained)
{
    hada_parameter *parameter = &net->parameters[net->parameter_count++];
    *parameter = (hada_parameter){.dims = dims, .count = 1, .trained = trained, .layer = layer};
    for (int d = 0; d < dims; d++) {
        parameter->shape[d] = shape[d];
        parameter->count = hada_size_product(parameter->count, (size_t)shape[d]); /* SIZE_MAX: too many */
    }
    if (colour < 0)
        snprintf(parameter->name, sizeof parameter->name, "%s.%s", net->layers[layer].name, what);
    else
        snprintf(parameter->name, sizeof parameter->name, "%s.%d.%s", net->layers[layer].name, colour, what);
}

static void add_parameters(hada_net *net, int index)
{
    hada_layer *layer = &net->layers[index];
    const int64_t out = layer->channels, k = layer->kernel;
    const int64_t in = layer->input_count ? net->layers[layer->inputs[0]].channels : 0;
    layer->parameter = parameters_of(net, layer) ? net->parameter_count : -1;
    if (layer->kind == HADA_LAYER_CONV) {
        const int64_t shape[4] = {layer->transposed ? in : out, layer->transposed ? out : in, k, k};
        add_parameter(net, index, -1, "weight", 4, shape, 1);
    } else if (layer->kind == HADA_LAYER_LINEAR) {
        add_parameter(net, index, -1, "weight", 2, (int64_t[]){out, layer->in}, 1);
    } else if (layer->kind == HADA_LAYER_NORM) {
        static const char *const names[4] = {"weight", "bias", "running_mean", "running_var"};
        for (int colour = 0; colour < net->colours; colour++)
            for (int i = 0; i < 4; i++)
                add_parameter(net, index, net->colours > 1 ? colour : -1, names[i], 1, &out, i < 2);
        return;
    }
    if (layer->parameter >= 0 && layer->bias)
        add_parameter(net, index, -1, "bias", 1, &out, 1);
}

static int by_name(const void *a, const void *b)
{
    const hada_parameter *const *one = a, *const *two = b;
    return strcmp((*one)->name, (*two)->name);
}

/* No parameter without a name, no two of the same. */
static hada_status check_names(const hada_net *net, hada_error *err)
{
    const size_t count = (size_t)net->parameter_count;
    const hada_parameter **sorted = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(sorted, count, "the table of parameters", err));
    for (size_t i = 0; i < count; i++)
        sorted[i] = &net->parameters[i];
    qsort(sorted, count, sizeof *sorted, by_name);
    for (size_t i = 0; i < count; i++)
        if (*sorted[i]->name == '.' || (i && !by_name(&sorted[i - 1], &sorted[i])))
            HADA_TRY_OR_DONE(refuse(net, sorted[i]->layer, "needs a name of its own for its parameters", err));
done:
    free(sorted);
    return status;
}

static hada_status make_table(hada_net *net, hada_error *err)
{
    size_t count = 0;
    for (int i = 0; i < net->count; i++)
        count += (size_t)parameters_of(net, &net->layers[i]);
    if (count > MOST_PARAMETERS)
        return hada_fail(err, HADA_ERROR_MODEL, "the net has %zu tensors of parameters; at most %d are offered", count,
                         MOST_PARAMETERS);
    HADA_TRY(HADA_NEW(net->parameters, count, "the table of parameters", err));
    for (int i = 0; i < net->count; i++)
        add_parameters(net, i);
    return HADA_OK;
}

/* Before memory for them is taken. */
static hada_status check_count(const hada_net *net, hada_error *err)
{
    const uint64_t most = net->most ? net->most : SIZE_MAX / sizeof *net->values;
    uint64_t count = 0;
    for (int i = 0; i < net->parameter_count; i++) {
        const uint64_t more = net->parameters[i].count;
        if (more > most - count)
            return hada_fail(err, HADA_ERROR_MODEL,
                             "the net's description speaks of more than %llu parameters, which is all that its file or "
                             "the limits allow (options.limits parameters=N)",
                             (unsigned long long)most);
        count += more;
    }
    return HADA_OK;
}

static hada_status make_parameters(hada_net *net, hada_error *err)
{
    HADA_TRY(make_table(net, err));
    HADA_TRY(check_count(net, err));
    HADA_TRY(check_names(net, err));
    for (int trained = 1; trained >= 0; trained--) {
        for (int i = 0; i < net->parameter_count; i++) {
            hada_parameter *parameter = &net->parameters[i];
            if (parameter->trained != trained)
                continue;
            parameter->offset = net->floats;
            net->floats += parameter->count;
        }
        if (trained)
            net->trained = net->floats;
    }
    return HADA_NEW(net->values, net->floats, "the weights", err);
}

hada_status hada_net_finish(hada_net *net, hada_error *err)
{
    if (net->count < 2)
        return hada_fail(err, HADA_ERROR_MODEL, "a net has an input and at least one more layer");
    for (int i = 0; i < net->count; i++) {
        HADA_TRY(check_inputs(net, i, err));
        HADA_TRY(check_numbers(net, i, err));
        set_channels(net, i);
        if (net->layers[i].channels > MOST_CHANNELS)
            HADA_TRY(refuse(net, i, "has too many channels", err));
    }
    HADA_TRY(check_used(net, err));
    HADA_TRY(make_parameters(net, err));
    net->info = (hada_net_info){.channels = net->layers[0].channels * net->colours,
                                .out_channels = net->layers[net->count - 1].channels * net->colours,
                                .shared = net->colours > 1,
                                .layers = net->count,
                                .parameters = net->parameter_count,
                                .trained = net->trained,
                                .values = net->floats};
    return HADA_OK;
}

hada_status hada_net_copy(hada_net **out, const hada_net *net, hada_error *err)
{
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_net_begin(out, net->colours, err));
    (*out)->shares = net->shares;
    for (int i = 0; i < net->count; i++)
        HADA_TRY_OR_DONE(hada_net_add(*out, &net->layers[i], NULL, err));
    HADA_TRY_OR_DONE(hada_net_finish(*out, err));
    memcpy((*out)->values, net->values, net->floats * sizeof *net->values);
done:
    if (status)
        hada_net_destroy(out);
    return status;
}

const hada_parameter *hada_net_find(const hada_net *net, const char *name)
{
    for (int i = 0; i < net->parameter_count; i++)
        if (!strcmp(net->parameters[i].name, name))
            return &net->parameters[i];
    return NULL;
}

const hada_parameter *hada_net_parameter(const hada_net *net, int layer, int colour, int which)
{
    return &net->parameters[net->layers[layer].parameter + 4 * colour + which];
}

/* FNV-1a, 64 bits (Fowler, Noll, Vo): a sequence of its own for every name. */
static uint64_t hash_of(const char *name)
{
    uint64_t hash = 0xcbf29ce484222325u;
    for (; *name; name++)
        hash = (hash ^ (unsigned char)*name) * 0x100000001b3u;
    return hash;
}

/* Before a ReLU normal numbers of variance 2 / fan (He et al. 2015), else PyTorch's own: uniform in +- 1 / sqrt(fan).
 * They depend on the seed and the parameter's name alone: a net that gains a layer starts the others as before. */
static void draw(const hada_parameter *parameter, int rectified, uint64_t seed, float *values)
{
    double fan = 1.0;
    hada_random random;
    for (int d = 1; d < parameter->dims; d++)
        fan *= (double)parameter->shape[d];
    const double normal = sqrt(2.0) / sqrt(fan), bound = sqrt(3.0) * (1.0 / sqrt(3.0 * fan));
    hada_random_seed(&random, seed, hash_of(parameter->name));
    for (size_t i = 0; i < parameter->count; i++)
        values[i] =
            (float)(rectified ? normal * hada_random_normal(&random) : hada_random_range(&random, -bound, bound));
}

void hada_net_init(hada_net *net, uint64_t seed)
{
    for (int i = 0; i < net->parameter_count; i++) {
        const hada_parameter *parameter = &net->parameters[i];
        const hada_layer *layer = &net->layers[parameter->layer];
        float *values = net->values + parameter->offset;
        if (parameter->dims > 1) {
            const hada_activation next = layer->activation;
            draw(parameter, next == HADA_ACTIVATION_RELU || next == HADA_ACTIVATION_LEAKY_RELU, seed, values);
            continue;
        }
        /* biases and running means 0; a batch norm's weight and running variance 1 */
        const int one = layer->kind == HADA_LAYER_NORM && (i - layer->parameter) % 4 % 3 == 0;
        for (size_t k = 0; k < parameter->count; k++)
            values[k] = one ? 1.0f : 0.0f;
    }
}

const hada_net_info *hada_net_get_info(const hada_net *net)
{
    if (!net)
        return NULL;
    return &net->info;
}

/* Rows and columns that the layers give. */

/* Pixels along one axis; 0 or less: none are left. Pads may be as large as kernels. */
static int conv_pixels(const hada_layer *layer, int in)
{
    if (layer->transposed) {
        const int64_t out = ((int64_t)in - 1) * layer->stride - 2 * layer->pad + layer->kernel + layer->output_pad;
        return out > HADA_NET_MOST_PIXELS ? HADA_NET_MOST_PIXELS + 1 : (int)out;
    }
    return in + 2 * layer->pad < layer->kernel ? 0 : (in + 2 * layer->pad - layer->kernel) / layer->stride + 1;
}

static int pool_pixels(const hada_layer *layer, int in)
{
    return in < layer->kernel ? 0 : (in - layer->kernel) / layer->stride + 1;
}

static hada_size size_of(const hada_layer *layer, const hada_size *sizes)
{
    const hada_size in = sizes[layer->inputs[0]];
    switch (layer->kind) {
    case HADA_LAYER_CONV: return (hada_size){conv_pixels(layer, in.rows), conv_pixels(layer, in.cols)};
    case HADA_LAYER_POOL: return (hada_size){pool_pixels(layer, in.rows), pool_pixels(layer, in.cols)};
    case HADA_LAYER_RESIZE: return layer->like >= 0 ? sizes[layer->like] : (hada_size){layer->rows, layer->cols};
    case HADA_LAYER_LINEAR: return (hada_size){1, 1};
    default: return in;
    }
}

hada_status hada_net_sizes(const hada_net *net, int rows, int cols, hada_size *sizes, hada_error *err)
{
    for (int i = 0; i < net->count; i++) {
        const hada_layer *layer = &net->layers[i];
        const hada_size size = i ? size_of(layer, sizes) : (hada_size){rows, cols};
        if (size.rows < 1 || size.cols < 1 || size.rows > HADA_NET_MOST_PIXELS || size.cols > HADA_NET_MOST_PIXELS)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "an image of %d x %d pixels is too %s for this net: "
                             "layer %d (%s %s) gives %d x %d",
                             rows, cols,
                             size.rows > HADA_NET_MOST_PIXELS || size.cols > HADA_NET_MOST_PIXELS ? "large" : "small",
                             i, hada_net_word(HADA_WORDS_KIND, (int)layer->kind), layer->name, size.rows, size.cols);
        if (layer->kind == HADA_LAYER_LINEAR) {
            const hada_size in = sizes[layer->inputs[0]];
            const long long values = (long long)net->layers[layer->inputs[0]].channels * in.rows * in.cols;
            if (values != layer->in)
                return hada_fail(err, HADA_ERROR_SIZE,
                                 "layer %d (linear %s) takes %d values of an image, "
                                 "but %lld come from %d x %d pixels: "
                                 "resize the image, or change the list",
                                 i, layer->name, layer->in, values, rows, cols);
        }
        sizes[i] = size;
    }
    return HADA_OK;
}

hada_status hada_net_output_size(const hada_net *net, int rows, int cols, hada_size *out, hada_error *err)
{
    hada_size *sizes = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(sizes, (size_t)net->count, "a net", err));
    HADA_TRY_OR_DONE(hada_net_sizes(net, rows, cols, sizes, err));
    *out = sizes[net->count - 1];
done:
    free(sizes);
    return status;
}
