/* Lists of layers as JSON text and back (docs/explanation/nets.md). A layer's object names
 * what differs from hada_layer_of(). */
#include <hadalens/limits.h>
#include <jansson.h>

#include "core/input.h"
#include "netlist/net_list.h"

#define FORMAT "hadalens-net-1"

/* The attributes that are numbers and which kinds have them. */
enum { INTEGER, REAL };
typedef struct attribute {
    const char *key;
    int type;
    size_t place;
    unsigned kinds; /* bits */
} attribute;
#define BIT(kind) (1u << HADA_LAYER_##kind)
#define ATTRIBUTE(k, t, f, bits)                                                                                       \
    {                                                                                                                  \
        k, t, offsetof(hada_layer, f), bits                                                                            \
    }
static const attribute attributes[] = {
    ATTRIBUTE("channels", INTEGER, channels, BIT(INPUT) | BIT(CONV) | BIT(LINEAR)),
    ATTRIBUTE("in", INTEGER, in, BIT(LINEAR)),
    ATTRIBUTE("kernel", INTEGER, kernel, BIT(CONV) | BIT(POOL)),
    ATTRIBUTE("stride", INTEGER, stride, BIT(CONV) | BIT(POOL)),
    ATTRIBUTE("pad", INTEGER, pad, BIT(CONV)),
    ATTRIBUTE("transposed", INTEGER, transposed, BIT(CONV)),
    ATTRIBUTE("output_pad", INTEGER, output_pad, BIT(CONV)),
    ATTRIBUTE("bias", INTEGER, bias, BIT(CONV) | BIT(LINEAR)),
    ATTRIBUTE("slope", REAL, slope, BIT(CONV) | BIT(LINEAR) | BIT(ACTIVATION)),
    ATTRIBUTE("like", INTEGER, like, BIT(RESIZE)),
    ATTRIBUTE("rows", INTEGER, rows, BIT(RESIZE)),
    ATTRIBUTE("cols", INTEGER, cols, BIT(RESIZE)),
    ATTRIBUTE("eps", REAL, eps, BIT(NORM)),
    ATTRIBUTE("momentum", REAL, momentum, BIT(NORM)),
    ATTRIBUTE("p", REAL, p, BIT(DROPOUT)),
};
#define ATTRIBUTES (sizeof attributes / sizeof *attributes)

/* The attributes that are words. */
typedef struct word {
    const char *key;
    hada_net_words list;
    unsigned kinds;
} word;
static const word words[] = {
    {"activation", HADA_WORDS_ACTIVATION, BIT(CONV) | BIT(LINEAR) | BIT(ACTIVATION)},
    {"pool", HADA_WORDS_POOL, BIT(POOL)},
    {"resize", HADA_WORDS_RESIZE, BIT(RESIZE)},
};
#define WORDS (sizeof words / sizeof *words)

static int get_word(const hada_layer *layer, size_t which)
{
    return which == 0 ? (int)layer->activation : which == 1 ? (int)layer->pool : (int)layer->resize;
}

static void set_word(hada_layer *layer, size_t which, int value)
{
    if (which == 0)
        layer->activation = (hada_activation)value;
    else if (which == 1)
        layer->pool = (hada_pool)value;
    else
        layer->resize = (hada_resize)value;
}

static const void *field(const hada_layer *layer, const attribute *a)
{
    return (const char *)layer + a->place;
}

/* Whether the kind of a layer has an attribute. */
static int has(const hada_layer *layer, unsigned kinds)
{
    return (kinds >> (unsigned)layer->kind & 1u) != 0;
}

static json_t *describe_layer(const hada_layer *layer)
{
    const hada_layer usual = hada_layer_of(layer->kind, "", 0);
    json_t *object = json_pack("{s:s}", "layer", hada_net_word(HADA_WORDS_KIND, (int)layer->kind));
    int bad = !object;
    if (*layer->name)
        bad |= json_object_set_new(object, "name", json_string(layer->name));
    if (layer->input_count) {
        json_t *from = json_array();
        for (int i = 0; i < layer->input_count; i++)
            bad |= json_array_append_new(from, json_integer(layer->inputs[i]));
        bad |= json_object_set_new(object, "from", from);
    }
    for (size_t i = 0; i < WORDS; i++)
        if (has(layer, words[i].kinds) && (i || get_word(layer, i)))
            bad |= json_object_set_new(object, words[i].key,
                                       json_string(hada_net_word(words[i].list, get_word(layer, i))));
    for (size_t i = 0; i < ATTRIBUTES; i++) {
        const attribute *a = &attributes[i];
        const void *value = field(layer, a), *other = field(&usual, a);
        if (!has(layer, a->kinds) || !memcmp(value, other, a->type == INTEGER ? sizeof(int) : sizeof(float)))
            continue;
        json_t *number =
            a->type == INTEGER ? json_integer(*(const int *)value) : json_real((double)*(const float *)value);
        bad |= json_object_set_new(object, a->key, number);
    }
    if (!bad)
        return object;
    json_decref(object);
    return NULL;
}

hada_status hada_net_describe(const hada_net *net, char **out, hada_error *err)
{
    HADA_NEED(out && net, err);
    json_t *layers = json_array();
    int bad = !layers;
    for (int i = 0; i < net->count; i++)
        bad |= json_array_append_new(layers, describe_layer(&net->layers[i]));
    json_t *root = json_pack("{s:s, s:i, s:o}", "format", FORMAT, "colours", net->colours, "layers", layers);
    if (root && net->shares)
        bad |= json_object_set_new(root, "shares", json_true());
    *out = bad || !root ? NULL : json_dumps(root, JSON_COMPACT | JSON_REAL_PRECISION(9));
    json_decref(root);
    return *out ? HADA_OK : hada_fail(err, HADA_ERROR_MEMORY, "no memory for a net's description");
}

static hada_status damaged(int index, const char *what, const char *why, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_MODEL, "the net's description is not usable: layer %d: %.100s %s", index, what,
                     why);
}

static hada_status read_attribute(hada_layer *layer, int index, const char *key, const json_t *value, hada_error *err)
{
    for (size_t i = 0; i < WORDS; i++) {
        if (strcmp(key, words[i].key) || !has(layer, words[i].kinds))
            continue;
        const int number = hada_net_word_find(words[i].list, json_string_value(value));
        if (number < 0)
            return damaged(index, key, "is none of the words that it can be", err);
        set_word(layer, i, number);
        return HADA_OK;
    }
    for (size_t i = 0; i < ATTRIBUTES; i++) {
        const attribute *a = &attributes[i];
        if (strcmp(key, a->key) || !has(layer, a->kinds))
            continue;
        void *place = (char *)layer + a->place;
        if (a->type == REAL) {
            if (!json_is_number(value))
                return damaged(index, key, "is not a number", err);
            *(float *)place = (float)json_number_value(value);
            return HADA_OK;
        }
        const json_int_t number = json_is_boolean(value) ? json_is_true(value) : json_integer_value(value);
        if ((!json_is_integer(value) && !json_is_boolean(value)) || number < -1 || number > 1000000000)
            return damaged(index, key, "is not a whole number that can be", err);
        *(int *)place = (int)number;
        return HADA_OK;
    }
    return damaged(index, key, "is nothing that this kind of layer has", err);
}

static hada_status read_from(hada_layer *layer, int index, const json_t *from, hada_error *err)
{
    if (!from) { /* the layer before */
        layer->inputs[0] = index - 1;
        return HADA_OK;
    }
    const size_t count = json_is_integer(from) ? 1 : json_array_size(from);
    if (!count || count > HADA_LAYER_INPUTS)
        return damaged(index, "from", "is neither a layer's number nor a list of some", err);
    for (size_t i = 0; i < count; i++) {
        const json_t *number = json_is_integer(from) ? from : json_array_get(from, i);
        if (!json_is_integer(number) || json_integer_value(number) < 0 || json_integer_value(number) > 1000000)
            return damaged(index, "from", "holds something that is no layer's number", err);
        layer->inputs[i] = (int)json_integer_value(number);
    }
    layer->input_count = (int)count;
    return HADA_OK;
}

static hada_status read_layer(hada_net *net, int index, const json_t *object, hada_error *err)
{
    const char *name = json_string_value(json_object_get(object, "name"));
    const int kind = hada_net_word_find(HADA_WORDS_KIND, json_string_value(json_object_get(object, "layer")));
    if (kind < 0)
        return damaged(index, "layer", "is no kind of layer", err);
    if (name && strlen(name) >= HADA_LAYER_NAME)
        return damaged(index, "name", "is too long", err);
    hada_layer layer = hada_layer_of((hada_layer_kind)kind, name, 0);
    if (kind != HADA_LAYER_INPUT)
        HADA_TRY(read_from(&layer, index, json_object_get(object, "from"), err));
    const char *key;
    json_t *value;
    json_object_foreach((json_t *)(uintptr_t)object, key, value)
    {
        if (strcmp(key, "layer") && strcmp(key, "name") && strcmp(key, "from"))
            HADA_TRY(read_attribute(&layer, index, key, value, err));
    }
    return hada_net_add(net, &layer, NULL, err);
}

static hada_status read_list(hada_net **out, const json_t *root, uint64_t most, hada_error *err)
{
    const char *format = json_string_value(json_object_get(root, "format"));
    const json_t *layers = json_object_get(root, "layers"), *colours = json_object_get(root, "colours");
    if (!format || strcmp(format, FORMAT) || !json_is_array(layers))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "this is not the description of a net (format " FORMAT " with a list of layers)");
    const json_int_t count = colours ? json_integer_value(colours) : 1;
    HADA_TRY(hada_net_begin(out, count > 0 && count < 1000 ? (int)count : 0, err));
    (*out)->shares = json_is_true(json_object_get(root, "shares"));
    for (size_t i = 0; i < json_array_size(layers); i++)
        HADA_TRY(read_layer(*out, (int)i, json_array_get(layers, i), err));
    (*out)->most = most;
    return hada_net_finish(*out, err);
}

hada_status hada_net_create(hada_net **out, const char *description, uint64_t seed, hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    HADA_NEED(out && description, err);
    *out = NULL;
    const hada_status status = hada_limits_get(&limits, err);
    return status ? status : hada_net_create_within(out, description, limits.parameters, seed, err);
}

hada_status hada_net_create_within(hada_net **out, const char *description, uint64_t most, uint64_t seed,
                                   hada_error *err)
{
    hada_limits limits = {.size = sizeof limits};
    hada_status status = HADA_OK;
    json_t *root = NULL;
    json_error_t why;
    HADA_TRY_OR_DONE(hada_limits_get(&limits, err));
    const size_t length = strlen(description);
    if (length > limits.text)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net's description has %zu bytes, more than the limits allow (options.limits text=N)",
                         length);
    if (hada_json_is_bloated(description, length))
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the net's description is not usable: it is made of little else than brackets and commas");
    root = json_loadb(description, length, JSON_REJECT_DUPLICATES, &why);
    if (!root)
        return hada_fail(err, HADA_ERROR_MODEL, "the net's description is not JSON: %s at its byte %d", why.text,
                         why.position);
    HADA_TRY_OR_DONE(read_list(out, root, most, err));
    hada_net_init(*out, seed);
done:
    json_decref(root);
    if (status)
        hada_net_destroy(out);
    return status;
}
