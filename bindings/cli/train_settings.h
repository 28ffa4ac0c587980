/* What the parts of `train` share. */
#ifndef HADA_CLI_TRAIN_SETTINGS_H
#define HADA_CLI_TRAIN_SETTINGS_H

#include "option.h"

#include <hadalens/dataset.h>
#include <hadalens/train.h>

typedef struct hada_cli_train_settings {
    hada_cli_common common;
    const char *model, *output, *net, *vgg, *log, *hold_out, *dark;
    int stage, random, form, boundary, window[2], net_size[2], skip_incomplete;
    int steps, epochs, batch, at_once, recompute, critic, critic_steps;
    int rule, schedule, period, warmup;
    double rate, filter_rate, critic_rate, last_rate, clip, decay;
    double mse, perceptual, adversarial, variation;
    int variation_squared, shift, flips, plane_flips;
    double noise, exposure;
    int validate_every, validate_most, show_every, save_every, patience, keep, resume, restart;
    uint64_t seed;
} hada_cli_train_settings;

enum { HADA_CLI_COUNT_DEFAULT = -1 }; /* of counts that were not given; reals are NaN */

/* train_data.c: a data set in two parts: the last pairs of each depth are held out. */
typedef struct hada_cli_train_data {
    hada_dataset *all, *learn, *held_out;
    hada_pairs pairs, held_pairs;
    int learned, held; /* pairs */
} hada_cli_train_data;
hada_status hada_cli_train_data_make(hada_cli *cli, const hada_cli_train_settings *set, const char *folder,
                                     hada_cli_train_data *data, hada_error *err);
void hada_cli_train_data_free(hada_cli_train_data *data);

/* train_start.c: options as the stage has them and the command line changes them. `net` is a net file's, to be
 * destroyed by the caller after the trainer was made; `augment` is pointed to by the options. */
hada_status hada_cli_train_options(hada_cli *cli, const hada_cli_train_settings *set, const hada_cli_train_data *data,
                                   hada_train_options *options, hada_augment *augment, hada_net **net, hada_error *err);

/* The model to begin with: that of -m, else a blank one (filters at random, conventional), else the exact fit of the
 * pairs to learn from. */
hada_status hada_cli_train_model(hada_cli *cli, const hada_cli_train_settings *set, const hada_cli_train_data *data,
                                 hada_context *context, hada_model **model, hada_error *err);

hada_stage hada_cli_train_stage(const hada_cli_train_settings *set);

/* train_loop.c: steps until the end, the checkpoint and the best model on the way. */
typedef struct hada_cli_train_run {
    hada_cli *cli;
    const hada_cli_train_settings *set;
    const hada_cli_train_data *data;
    hada_trainer *trainer;
    uint64_t steps;
    char *log_folder, *checkpoint;
} hada_cli_train_run;
hada_status hada_cli_train_loop(hada_cli_train_run *run, hada_error *err);

/* train_picture.c: raw frame, plane before the net, output and truth of a few held-out pairs, a row each. */
hada_status hada_cli_train_picture(hada_trainer *trainer, int held, const char *path, hada_error *err);

#endif
