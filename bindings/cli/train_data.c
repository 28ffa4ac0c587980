#include "train_settings.h"

#include <math.h>

/* Called from several threads: reads nothing but what stays as it is. */
static hada_status read_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    return hada_dataset_read(user, depth, pair, raw, scene, err);
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

static hada_pairs as_pairs(hada_dataset *data)
{
    const hada_dataset_info *info = hada_dataset_get_info(data);
    return (hada_pairs){sizeof(hada_pairs), info->depths, info->counts, read_pair, data};
}

hada_status hada_cli_train_data_make(hada_cli *cli, const hada_cli_train_settings *set, const char *folder,
                                     hada_cli_train_data *data, hada_error *err)
{
    double hold_out;
    hada_dataset_options scan;
    hada_status status = HADA_OK;
    *data = (hada_cli_train_data){0};
    hada_dataset_options_init(&scan);
    scan.skip_incomplete = set->skip_incomplete;
    HADA_TRY(hada_dataset_scan(&data->all, folder, &scan, err));
    if (hada_dataset_get_info(data->all)->incomplete)
        hada_cli_warn(cli, "left out: %s", hada_dataset_get_info(data->all)->incomplete_text);
    HADA_TRY(read_hold_out(set->hold_out, &hold_out, err));
    HADA_TRY(hada_dataset_split(data->all, hold_out, &data->learn, &data->held_out, err));
    data->pairs = as_pairs(data->learn);
    data->held_pairs = as_pairs(data->held_out);
    data->learned = hada_dataset_get_info(data->learn)->pairs;
    data->held = hada_dataset_get_info(data->held_out)->pairs;
    if (!data->held)
        hada_cli_warn(cli, "no pair is held out: nothing tells how good training is, and the last parameters are kept");
done:
    if (status)
        hada_cli_train_data_free(data);
    return status;
}

void hada_cli_train_data_free(hada_cli_train_data *data)
{
    hada_dataset_destroy(&data->learn);
    hada_dataset_destroy(&data->held_out);
    hada_dataset_destroy(&data->all);
    *data = (hada_cli_train_data){0};
}
