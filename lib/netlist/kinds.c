/* The words by which lists of layers name kinds. */
#include "netlist/net_list.h"

static const char *const layer_kinds[HADA_LAYER_KINDS] = {"input",  "conv", "activation", "pool",  "resize",
                                                          "concat", "norm", "dropout",    "linear"};
static const char *const activations[] = {"none", "relu", "leaky_relu", "sigmoid"};
static const char *const pools[] = {"max", "mean"};
static const char *const resizes[] = {"nearest", "linear", "linear_aligned", "cubic", "cubic_aligned"};

#define COUNT(list) ((int)(sizeof(list) / sizeof *(list)))

static const char *name_of(const char *const *names, int count, int number)
{
    return number >= 0 && number < count ? names[number] : NULL;
}

static int find(const char *const *names, int count, const char *name)
{
    for (int i = 0; name && i < count; i++)
        if (!strcmp(names[i], name))
            return i;
    return -1;
}

const char *hada_layer_kind_name(int kind)
{
    return name_of(layer_kinds, COUNT(layer_kinds), kind);
}

const char *hada_activation_name(int activation)
{
    return name_of(activations, COUNT(activations), activation);
}

const char *hada_pool_name(int pool)
{
    return name_of(pools, COUNT(pools), pool);
}

const char *hada_resize_name(int resize)
{
    return name_of(resizes, COUNT(resizes), resize);
}

int hada_layer_kind_find(const char *name)
{
    return find(layer_kinds, COUNT(layer_kinds), name);
}

int hada_activation_find(const char *name)
{
    return find(activations, COUNT(activations), name);
}

int hada_pool_find(const char *name)
{
    return find(pools, COUNT(pools), name);
}

int hada_resize_find(const char *name)
{
    return find(resizes, COUNT(resizes), name);
}
