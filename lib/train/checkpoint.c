/* Checkpoints: where training stands, in a safetensors file (docs/training.md lists what it holds). */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/alloc.h"
#include "io/safetensors.h"
#include "train/trainer.h"

#define FORMAT "hadalens-checkpoint-1"

static const char *const stages[] = {"", "filters", "enhance", "adversarial", "joint", "conventional"};
static const char *const rules[] = {"rmsprop", "adam", "adamw"};
enum { NAME = 48, NUMBERS = 8 };

/* What must agree, with the words of a message where it does not. */
typedef struct fact {
    const char *key, *what;
    char text[64];
} fact;

static void list_facts(const hada_trainer *trainer, fact facts[NUMBERS], int *count)
{
    const hada_train_options *options = &trainer->options;
    const hada_model_info *info = &trainer->info;
    int n = 0;
    facts[n] = (fact){.key = "stage", .what = "the stage"};
    snprintf(facts[n++].text, sizeof facts->text, "%s", stages[options->stage]);
    facts[n] = (fact){.key = "seed", .what = "the seed"};
    snprintf(facts[n++].text, sizeof facts->text, "%" PRIu64, options->seed);
    facts[n] = (fact){.key = "batch", .what = "the batch"};
    snprintf(facts[n++].text, sizeof facts->text, "%d", options->batch);
    facts[n] = (fact){.key = "rule", .what = "the rule"};
    snprintf(facts[n++].text, sizeof facts->text, "%s", rules[options->rule]);
    facts[n] = (fact){.key = "camera", .what = "the camera's depths, channels and sizes"};
    snprintf(facts[n++].text, sizeof facts->text, "%d %d %dx%d %dx%d %d", info->depths, info->channels, info->grid_rows,
             info->grid_cols, info->window_rows, info->window_cols, (int)options->form);
    facts[n] = (fact){.key = "model", .what = "the model's filters"};
    snprintf(facts[n++].text, sizeof facts->text, "%016" PRIx64, trainer->fingerprint);
    *count = n;
}

static void name_of(int group, const char *what, char name[NAME])
{
    if (group >= HADA_GROUP_FILTERS)
        snprintf(name, NAME, "filters.%d.%s", group - HADA_GROUP_FILTERS, what);
    else
        snprintf(name, NAME, "%s.%s", group == HADA_GROUP_NET ? "net" : "critic", what);
}

static hada_status describe(const hada_trainer *trainer, char **net, char **critic, hada_error *err)
{
    hada_status status = trainer->net ? hada_net_describe(trainer->net, net, err) : HADA_OK;
    if (!status && trainer->critic)
        status = hada_net_describe(trainer->critic, critic, err);
    return status;
}

static hada_status put_number(hada_tensors_writer *writer, const char *key, uint64_t value, hada_error *err)
{
    char text[32];
    snprintf(text, sizeof text, "%" PRIu64, value);
    return hada_tensors_put_meta(writer, key, text, err);
}

static hada_status put_metadata(hada_trainer *trainer, hada_tensors_writer *writer, hada_error *err)
{
    const hada_progress *progress = &trainer->progress;
    fact facts[NUMBERS];
    char *net = NULL, *critic = NULL;
    int count;
    list_facts(trainer, facts, &count);
    hada_status status = hada_tensors_put_meta(writer, "format", FORMAT, err);
    for (int i = 0; !status && i < count; i++)
        status = hada_tensors_put_meta(writer, facts[i].key, facts[i].text, err);
    if (!status)
        status = put_number(writer, "step", progress->step, err);
    if (!status)
        status = put_number(writer, "place", progress->place, err);
    if (!status)
        status = put_number(writer, "rollbacks", (uint64_t)progress->bad, err);
    if (!status)
        status = put_number(writer, "halvings", (uint64_t)progress->halvings, err);
    if (!status)
        status = describe(trainer, &net, &critic, err);
    if (!status && net)
        status = hada_tensors_put_meta(writer, "net", net, err);
    if (!status && critic)
        status = hada_tensors_put_meta(writer, "critic", critic, err);
    free(net);
    free(critic);
    return status;
}

/* Calls `work` for the arrays of all groups, in the order of the file. */
typedef struct array {
    char name[NAME];
    int group;
    hada_content content;
    size_t count;
} array;
typedef hada_status (*array_work)(hada_trainer *trainer, const array *what, void *user, hada_error *err);
static hada_status each_array(hada_trainer *trainer, array_work work, void *user, hada_error *err)
{
    static const struct {
        hada_content content;
        const char *word;
    } parts[] = {{HADA_CONTENT_VALUES, "values"}, {HADA_CONTENT_STATE, "state"}};
    hada_status status = HADA_OK;
    for (int g = 0; !status && g < trainer->groups; g++)
        for (int i = 0; !status && i < 2 && hada_trainer_has(trainer, g); i++) {
            array what = {.group = g, .content = parts[i].content};
            name_of(g, parts[i].word, what.name);
            what.count = hada_engine_count(trainer->workers->engine, g, what.content);
            status = work(trainer, &what, user, err);
        }
    return status;
}

static hada_status declare(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    const int64_t shape[] = {(int64_t)what->count};
    (void)trainer;
    return hada_tensors_declare(user, what->name, HADA_F32, 1, shape, err);
}

/* An array, to be freed. */
static hada_status fetch(hada_trainer *trainer, const array *what, float **out, hada_error *err)
{
    hada_status status = hada_alloc_raw((void **)out, what->count, sizeof **out, "a checkpoint", err);
    return status ? status : hada_trainer_read(trainer, what->group, what->content, *out, err);
}

static hada_status write_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    float *values;
    hada_status status = fetch(trainer, what, &values, err);
    if (!status)
        status = hada_tensors_write(user, values, what->count * sizeof *values, err);
    free(values);
    return status;
}

static hada_status is_finite(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    int *finite = user;
    float *values = NULL;
    if (!*finite || what->content != HADA_CONTENT_VALUES)
        return HADA_OK;
    hada_status status = fetch(trainer, what, &values, err);
    for (size_t i = 0; !status && *finite && i < what->count; i++)
        *finite = isfinite(values[i]);
    free(values);
    return status;
}

static hada_status write_all(hada_trainer *trainer, hada_tensors_writer *writer, hada_error *err)
{
    const int64_t groups[] = {trainer->groups};
    const size_t bytes = (size_t)trainer->groups * sizeof(uint64_t);
    hada_status status = put_metadata(trainer, writer, err);
    if (!status)
        status = hada_tensors_declare(writer, "steps", HADA_U64, 1, groups, err);
    if (!status)
        status = each_array(trainer, declare, writer, err);
    if (!status)
        status = hada_tensors_write(writer, trainer->progress.group_steps, bytes, err);
    return status ? status : each_array(trainer, write_array, writer, err);
}

/* The snapshot stays as it is: it holds values that were seen to give finite numbers, these here were not yet. */
hada_status hada_trainer_save(hada_trainer *trainer, const char *path, hada_error *err)
{
    hada_tensors_writer *writer;
    int finite = 1;
    if (!trainer || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_save: trainer and path are needed");
    hada_status status = each_array(trainer, is_finite, &finite, err);
    if (!status && !finite) {
        status = hada_snapshot_restore(trainer, err);
        trainer->progress.halvings++;
        trainer->progress.bad++;
    }
    if (!status)
        status = hada_tensors_create(&writer, path, err);
    if (status)
        return status;
    status = write_all(trainer, writer, err);
    if (!status)
        status = hada_tensors_sync(writer, err);
    if (!status)
        return hada_tensors_finish(&writer, err);
    hada_tensors_abandon(&writer);
    return status;
}

static hada_status check_text(const hada_tensors *file, const char *key, const char *what, const char *own, int quote,
                              hada_error *err)
{
    const char *text = hada_tensors_meta(file, key);
    if (!text && !own)
        return HADA_OK;
    if (text && own && !strcmp(text, own))
        return HADA_OK;
    if (quote && text && own)
        return hada_fail(err, HADA_ERROR_MODEL,
                         "the checkpoint belongs to another training: %s is %s there and %s here; give what the "
                         "training began with, or begin anew",
                         what, text, own);
    return hada_fail(err, HADA_ERROR_MODEL,
                     "the checkpoint belongs to another training: %s differs; give what the training began with, or "
                     "begin anew",
                     what);
}

static hada_status check_facts(hada_trainer *trainer, const hada_tensors *file, hada_error *err)
{
    fact facts[NUMBERS];
    char *net = NULL, *critic = NULL;
    int count;
    const char *format = hada_tensors_meta(file, "format");
    if (!format || strcmp(format, FORMAT))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "this is no checkpoint of this version");
    list_facts(trainer, facts, &count);
    hada_status status = HADA_OK;
    for (int i = 0; !status && i < count; i++)
        status = check_text(file, facts[i].key, facts[i].what, facts[i].text, strcmp(facts[i].key, "model") != 0, err);
    if (!status)
        status = describe(trainer, &net, &critic, err);
    if (!status)
        status = check_text(file, "net", "the net", net, 0, err);
    if (!status)
        status = check_text(file, "critic", "the discriminator", critic, 0, err);
    free(net);
    free(critic);
    return status;
}

static hada_status damaged(const char *what, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_FILE_FORMAT, "the checkpoint has no usable %s; it is damaged", what);
}

static hada_status get_number(const hada_tensors *file, const char *key, uint64_t *out, hada_error *err)
{
    const char *text = hada_tensors_meta(file, key);
    char *end;
    if (!text || *text < '0' || *text > '9')
        return damaged(key, err);
    *out = strtoull(text, &end, 10);
    return *end ? damaged(key, err) : HADA_OK;
}

static hada_status check_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    const hada_stored_tensor *tensor = hada_tensors_find(user, what->name);
    (void)trainer;
    return tensor && tensor->type == HADA_F32 && tensor->bytes == what->count * sizeof(float)
               ? HADA_OK
               : damaged(what->name, err);
}

static hada_status read_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    hada_snapshot *shot = &trainer->snapshot;
    float *to = what->content == HADA_CONTENT_VALUES ? shot->values[what->group] : shot->states[what->group];
    return hada_tensor_copy_f32(hada_tensors_find(user, what->name), 0, what->count, to, err);
}

/* Everything is checked before anything changes. */
static hada_status take(hada_trainer *trainer, hada_tensors *file, hada_error *err)
{
    hada_progress *progress = &trainer->progress;
    const size_t bytes = (size_t)trainer->groups * sizeof(uint64_t);
    const hada_stored_tensor *steps = hada_tensors_find(file, "steps");
    uint64_t step = 0, place = 0, bad = 0, halvings = 0;
    hada_status status = check_facts(trainer, file, err);
    if (!status)
        status = get_number(file, "step", &step, err);
    if (!status)
        status = get_number(file, "place", &place, err);
    if (!status)
        status = get_number(file, "rollbacks", &bad, err);
    if (!status)
        status = get_number(file, "halvings", &halvings, err);
    if (!status && (!steps || steps->type != HADA_U64 || steps->bytes != bytes))
        status = damaged("steps", err);
    if (!status)
        status = each_array(trainer, check_array, file, err);
    if (status)
        return status;
    status = each_array(trainer, read_array, file, err);
    for (int g = 0; !status && g < trainer->groups; g++) {
        status = hada_snapshot_give(trainer, g, err);
        trainer->snapshot.dirty[g] = 0;
    }
    if (status)
        return status;
    memcpy(progress->group_steps, steps->data, bytes);
    memcpy(trainer->snapshot.group_steps, steps->data, bytes);
    trainer->snapshot.step = progress->step = step;
    progress->place = place;
    progress->bad = (int)bad;
    progress->halvings = halvings < 1000 ? (int)halvings : 1000;
    hada_feed_destroy(&trainer->feed);
    return HADA_OK;
}

hada_status hada_trainer_load(hada_trainer *trainer, const char *path, hada_error *err)
{
    hada_tensors *file;
    if (!trainer || !path)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "hada_trainer_load: trainer and path are needed");
    hada_status status = hada_tensors_open(&file, path, err);
    if (status)
        return status;
    status = take(trainer, file, err);
    if (status)
        hada_error_prefix(err, "%s: ", path);
    hada_tensors_close(&file);
    return status;
}
