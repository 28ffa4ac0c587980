#include "netlist/init.h"

#include <math.h>
#include <string.h>

#include "core/random.h"

static const struct {
    const char *name;
    hada_init init;
} names[] = {
    {"zeros", HADA_INIT_ZEROS},
    {"constant", HADA_INIT_CONSTANT},
    {"xavier_uniform", HADA_INIT_XAVIER_UNIFORM},
    {"xavier_normal", HADA_INIT_XAVIER_NORMAL},
    {"kaiming_uniform", HADA_INIT_KAIMING_UNIFORM},
    {"kaiming_normal", HADA_INIT_KAIMING_NORMAL},
    {"torch", HADA_INIT_TORCH},
    {"glorot_uniform", HADA_INIT_XAVIER_UNIFORM},
    {"glorot_normal", HADA_INIT_XAVIER_NORMAL},
    {"he_uniform", HADA_INIT_KAIMING_UNIFORM},
    {"he_normal", HADA_INIT_KAIMING_NORMAL},
};
enum { NAMES = sizeof names / sizeof *names };

const char *hada_init_name(hada_init init)
{
    for (int i = 0; i < NAMES; i++)
        if (names[i].init == init)
            return names[i].name;
    return "unknown";
}

hada_status hada_init_find(const char *name, hada_init *out, hada_error *err)
{
    for (int i = 0; i < NAMES; i++)
        if (!strcmp(names[i].name, name)) {
            *out = names[i].init;
            return HADA_OK;
        }
    return hada_fail(err, HADA_ERROR_ARGUMENT,
                     "there is no initialisation \"%s\": take zeros, constant, xavier_uniform, xavier_normal, "
                     "kaiming_uniform, kaiming_normal or torch",
                     name);
}

hada_status hada_init_fans(const int64_t *shape, int dims, double *fan_in, double *fan_out, hada_error *err)
{
    if (dims != 2 && dims != 4)
        return hada_fail(err, HADA_ERROR_SIZE, "weights have 2 or 4 dimensions, not %d", dims);
    for (int i = 0; i < dims; i++)
        if (shape[i] < 1)
            return hada_fail(err, HADA_ERROR_SIZE, "weights with %lld values along a dimension are not possible",
                             (long long)shape[i]);
    const double kernel = dims == 4 ? (double)shape[2] * (double)shape[3] : 1.0;
    *fan_in = (double)shape[1] * kernel;
    *fan_out = (double)shape[0] * kernel;
    return HADA_OK;
}

/* FNV-1a, 64 bits (Fowler, Noll, Vo): a sequence of its own for every name. */
static uint64_t hash_of(const char *name)
{
    uint64_t hash = 0xcbf29ce484222325u;
    for (; *name; name++)
        hash = (hash ^ (unsigned char)*name) * 0x100000001b3u;
    return hash;
}

/* The standard deviation, or 0 for constants. */
static double deviation_of(const hada_init_desc *desc)
{
    const double gain = desc->value;
    switch (desc->init) {
    case HADA_INIT_XAVIER_UNIFORM:
    case HADA_INIT_XAVIER_NORMAL: return (gain != 0.0 ? gain : 1.0) * sqrt(2.0 / (desc->fan_in + desc->fan_out));
    case HADA_INIT_KAIMING_UNIFORM:
    case HADA_INIT_KAIMING_NORMAL: return (gain != 0.0 ? gain : sqrt(2.0)) / sqrt(desc->fan_in);
    case HADA_INIT_TORCH: return 1.0 / sqrt(3.0 * desc->fan_in);
    default: return 0.0;
    }
}

hada_status hada_init_fill(float *out, size_t count, const hada_init_desc *desc, const char *parameter, uint64_t seed,
                           hada_error *err)
{
    if ((int)desc->init < HADA_INIT_ZEROS || desc->init > HADA_INIT_TORCH)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no initialisation %d", (int)desc->init);
    const double deviation = deviation_of(desc);
    if (!isfinite(deviation) || !isfinite(desc->value) || deviation < 0.0)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "%s: initialisation %s with fans %g and %g and gain %g", parameter,
                         hada_init_name(desc->init), desc->fan_in, desc->fan_out, desc->value);
    const int normal = desc->init == HADA_INIT_XAVIER_NORMAL || desc->init == HADA_INIT_KAIMING_NORMAL;
    const double bound = sqrt(3.0) * deviation, level = desc->init == HADA_INIT_CONSTANT ? desc->value : 0.0;
    hada_random random;
    hada_random_seed(&random, seed, hash_of(parameter));
    for (size_t i = 0; i < count; i++)
        if (deviation == 0.0)
            out[i] = (float)level;
        else
            out[i] =
                (float)(normal ? deviation * hada_random_normal(&random) : hada_random_range(&random, -bound, bound));
    return HADA_OK;
}
