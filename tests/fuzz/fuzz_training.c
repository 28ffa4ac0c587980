/* Checkpoints, for a training of filters and a net that is small enough to be loaded hundreds of times a second. */
#include <hadalens/device.h>
#include <hadalens/model.h>
#include <hadalens/train.h>
#include <stdio.h>
#include <stdlib.h>

#include "fuzz.h"

enum { DEPTHS = 2 };

static const char list[] = "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 1},"
                           "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 2, \"activation\": \"relu\"},"
                           "{\"layer\": \"norm\", \"name\": \"b\"},"
                           "{\"layer\": \"conv\", \"name\": \"c\", \"channels\": 1}]}";

static struct {
    hada_context *context;
    hada_model *model;
    hada_net *net;
    hada_trainer *trainer;
    hada_dataset *pairs;
} fixed;

static void must(hada_status status, const hada_error *err)
{
    if (!status)
        return;
    fprintf(stderr, "checkpoint: %s\n", err->message);
    abort();
}

static hada_status no_pair(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    (void)user, (void)depth, (void)pair, (void)raw, (void)scene, (void)err;
    return HADA_ERROR_CANCELLED; /* no step is made */
}

static void end(void)
{
    hada_trainer_destroy(&fixed.trainer);
    hada_dataset_destroy(&fixed.pairs);
    hada_net_destroy(&fixed.net);
    hada_model_destroy(&fixed.model);
    hada_context_destroy(&fixed.context);
}

/* The camera is that of the corpus of models: the same numbers on every machine, so that checkpoints in the corpus stay
 * those of this training. */
void fuzz_checkpoint_begin(void)
{
    static const int counts[DEPTHS] = {1, 1};
    static const double distances[DEPTHS] = {1.0, 2.0};
    hada_train_options options;
    hada_error err = {0};
    hada_train_options_init(&options, HADA_STAGE_ADVERSARIAL);
    must(hada_context_create(&fixed.context, NULL, &err), &err);
    must(hada_model_load(&fixed.model, FUZZ_CORPUS "/model/small", &err), &err);
    must(hada_dataset_create(&fixed.pairs, DEPTHS, distances, counts, no_pair, NULL, NULL, &err), &err);
    must(hada_net_create(&fixed.net, list, 1, &err), &err);
    options.net_given = fixed.net;
    options.batch = 1;
    must(hada_trainer_create(&fixed.trainer, &fixed.context, 1, fixed.model, fixed.pairs, NULL, &options, &err), &err);
    const char *save = getenv("FUZZ_CHECKPOINT"); /* makes the corpus' first input anew */
    if (save)
        must(hada_trainer_save(fixed.trainer, save, &err), &err);
    atexit(end);
}

void fuzz_checkpoint(const uint8_t *data, size_t bytes)
{
    hada_error err = {0};
    fuzz_check_file(hada_trainer_load(fixed.trainer, fuzz_path(data, bytes), &err), &err);
}
