#include "pairs.h"
#include "train_settings.h"

#include <hadalens/tiff.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Called from several threads: reads nothing but what stays as it is. */
static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const hada_cli_train_data *data = user;
    return hada_cli_pair_load(&data->all.depth[depth].pair[pair], raw, scene, err);
}

static hada_status read_held(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const hada_cli_train_data *data = user;
    return read_pair(user, depth, data->learn_counts[depth] + pair, raw, scene, err);
}

/* "3": of each depth; "0.2": a share of each; without the option an eighth, at least one where there are three. */
static hada_status read_hold_out(const char *text, double *value, hada_error *err)
{
    *value = 0.125;
    if (!text)
        return HADA_OK;
    if (!hada_cli_read_real(text, value) || !(*value >= 0) || (*value >= 1 && *value != floor(*value)) || *value > 1e6)
        return hada_cli_error(err, HADA_ERROR_ARGUMENT,
                              "--hold-out takes a number of pairs of each depth, or a share such as 0.2; not '%s'",
                              text);
    return HADA_OK;
}

static hada_status split(const hada_cli_train_settings *set, hada_cli_train_data *data, hada_error *err)
{
    double value;
    hada_status status = read_hold_out(set->hold_out, &value, err);
    for (int z = 0; !status && z < data->all.depths; z++) {
        const int pairs = data->all.depth[z].pairs;
        int held = value >= 1 ? (int)value : (int)floor(value * pairs + 0.5);
        if (value > 0 && !held && pairs >= 3)
            held = 1;
        if (held >= pairs)
            return hada_cli_error(err, HADA_ERROR_DATASET,
                                  "%s has %d pair%s: nothing would be left to learn from with %d held out; give "
                                  "--hold-out a smaller number",
                                  data->all.depth[z].folder, pairs, pairs == 1 ? "" : "s", held);
        data->held_counts[z] = held;
        data->learn_counts[z] = pairs - held;
        data->held += held;
    }
    return status;
}

/* The data set without what is held out, for the exact fit. */
static hada_status make_learn(hada_cli_train_data *data, hada_error *err)
{
    const int depths = data->all.depths;
    data->learn = data->all;
    data->learn.depth = malloc((size_t)depths * sizeof *data->learn.depth);
    if (!data->learn.depth)
        return hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    memcpy(data->learn.depth, data->all.depth, (size_t)depths * sizeof *data->learn.depth);
    data->learn.pairs = data->all.pairs - data->held;
    data->learn.least_pairs = data->learn_counts[0];
    for (int z = 0; z < depths; z++) {
        data->learn.depth[z].pairs = data->learn_counts[z];
        if (data->learn_counts[z] < data->learn.least_pairs)
            data->learn.least_pairs = data->learn_counts[z];
    }
    return HADA_OK;
}

hada_status hada_cli_train_data_make(hada_cli *cli, const hada_cli_train_settings *set, const char *folder,
                                     hada_cli_train_data *data, hada_error *err)
{
    *data = (hada_cli_train_data){0};
    hada_status status = hada_cli_dataset_scan(&data->all, folder, set->skip_incomplete, err);
    if (status)
        return status;
    if (data->all.incomplete)
        hada_cli_warn(cli, "left out: %s", data->all.incomplete_text);
    data->learn_counts = calloc((size_t)data->all.depths, sizeof *data->learn_counts);
    data->held_counts = calloc((size_t)data->all.depths, sizeof *data->held_counts);
    if (!data->learn_counts || !data->held_counts)
        status = hada_cli_error(err, HADA_ERROR_MEMORY, "out of memory");
    if (!status)
        status = split(set, data, err);
    if (!status)
        status = make_learn(data, err);
    if (status) {
        hada_cli_train_data_free(data);
        return status;
    }
    data->pairs = (hada_pairs){sizeof(hada_pairs), data->all.depths, data->learn_counts, read_pair, data};
    data->held_out = (hada_pairs){sizeof(hada_pairs), data->all.depths, data->held_counts, read_held, data};
    if (!data->held)
        hada_cli_warn(cli, "no pair is held out: nothing tells how good training is, and the last parameters are kept");
    return HADA_OK;
}

void hada_cli_train_data_free(hada_cli_train_data *data)
{
    free(data->learn.depth);
    hada_cli_dataset_free(&data->all);
    free(data->learn_counts);
    free(data->held_counts);
    *data = (hada_cli_train_data){0};
}
