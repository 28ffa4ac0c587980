/* Checkpoints: where training stands, in a safetensors file (docs/explanation/nets.md lists what it holds). */
#include <inttypes.h>
#include <xxhash.h>

#include "io/folder.h"
#include "io/safetensors.h"
#include "model/model.h"
#include "train/trainer.h"

#define FORMAT "hadalens-checkpoint-1"

static const char *const stages[] = {"", "filters", "enhance", "adversarial", "", "conventional"};
static const char *const rules[] = {"rmsprop", "adam"};
enum { NAME = 48, NUMBERS = 8 };

/* What must agree, with the words of a message where it does not. */
typedef struct fact {
    const char *key, *what;
    char text[64];
} fact;

/* Of the filters that training stands on. */
static uint64_t fingerprint_of(const hada_model *model)
{
    const size_t values = (size_t)model->info.depths * (size_t)model->info.channels * hada_model_plane(model) * 2;
    return (uint64_t)(model->filter ? XXH3_64bits(model->filter, values * sizeof *model->filter)
                                    : XXH3_64bits(model->filter_half, values * sizeof *model->filter_half));
}

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
    snprintf(facts[n++].text, sizeof facts->text, "%016" PRIx64, fingerprint_of(trainer->model));
    *count = n;
}

/* The share of scenes of several depths, in parts of a milliard; NULL where none are composed, as before there were
 * any.
 */
static const char *compose_of(const hada_trainer *trainer, char text[32])
{
    const double share = trainer->options.compose;
    snprintf(text, 32, "%" PRIu64, (uint64_t)(share * 1e9 + 0.5));
    return share > 0.0 ? text : NULL;
}

/* The discriminator's word in files, and what it was in 0.1.0. */
static const char discriminator_word[] = "discriminator", old_discriminator_word[] = "critic";

static void name_of(int group, const char *what, char name[NAME])
{
    if (group >= HADA_GROUP_FILTERS)
        snprintf(name, NAME, "filters.%d.%s", group - HADA_GROUP_FILTERS, what);
    else
        snprintf(name, NAME, "%s.%s", group == HADA_GROUP_NET ? "net" : discriminator_word, what);
}

static hada_status describe(const hada_trainer *trainer, char **net, char **discriminator, hada_error *err)
{
    if (trainer->nets.net)
        HADA_TRY(hada_net_describe(trainer->nets.net, net, err));
    if (trainer->nets.discriminator)
        HADA_TRY(hada_net_describe(trainer->nets.discriminator, discriminator, err));
    return HADA_OK;
}

static hada_status put_number(hada_tensors_writer *writer, const char *key, uint64_t value, hada_error *err)
{
    char text[32];
    snprintf(text, sizeof text, "%" PRIu64, value);
    return hada_tensors_put_meta(writer, key, text, err);
}

static hada_status put_metadata(hada_trainer *trainer, hada_tensors_writer *writer, hada_error *err)
{
    const hada_train_progress *progress = &trainer->progress;
    fact facts[NUMBERS];
    char *net = NULL, *discriminator = NULL, share[32];
    int count;
    hada_status status = HADA_OK;
    list_facts(trainer, facts, &count);
    HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, "format", FORMAT, err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, facts[i].key, facts[i].text, err));
    if (compose_of(trainer, share))
        HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, "compose", share, err));
    HADA_TRY_OR_DONE(put_number(writer, "step", progress->step, err));
    HADA_TRY_OR_DONE(put_number(writer, "place", progress->place, err));
    HADA_TRY_OR_DONE(put_number(writer, "rollbacks", (uint64_t)progress->bad, err));
    HADA_TRY_OR_DONE(put_number(writer, "halvings", (uint64_t)progress->halvings, err));
    HADA_TRY_OR_DONE(describe(trainer, &net, &discriminator, err));
    if (net)
        HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, "net", net, err));
    if (discriminator)
        HADA_TRY_OR_DONE(hada_tensors_put_meta(writer, discriminator_word, discriminator, err));
done:
    HADA_FREE(net, discriminator);
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
    const hada_workers *workers = &trainer->workers;
    for (int g = 0; g < workers->groups; g++)
        for (int i = 0; i < 2 && hada_workers_have(workers, g); i++) {
            array what = {.group = g, .content = parts[i].content};
            name_of(g, parts[i].word, what.name);
            what.count = hada_workers_floats(workers, g, what.content);
            HADA_TRY(work(trainer, &what, user, err));
        }
    return HADA_OK;
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
    HADA_TRY(HADA_NEW_RAW(*out, what->count, "a checkpoint", err));
    return hada_workers_read(&trainer->workers, what->group, what->content, *out, err);
}

static hada_status write_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(fetch(trainer, what, &values, err));
    HADA_TRY_OR_DONE(hada_tensors_write(user, values, what->count * sizeof *values, err));
done:
    free(values);
    return status;
}

static hada_status is_finite(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    int *finite = user;
    float *values = NULL;
    hada_status status = HADA_OK;
    if (!*finite || what->content != HADA_CONTENT_VALUES)
        return HADA_OK;
    HADA_TRY_OR_DONE(fetch(trainer, what, &values, err));
    for (size_t i = 0; *finite && i < what->count; i++)
        *finite = isfinite(values[i]);
done:
    free(values);
    return status;
}

static hada_status write_all(hada_trainer *trainer, hada_tensors_writer *writer, hada_error *err)
{
    const int64_t groups[] = {trainer->workers.groups};
    const size_t bytes = (size_t)trainer->workers.groups * sizeof(uint64_t);
    HADA_TRY(put_metadata(trainer, writer, err));
    HADA_TRY(hada_tensors_declare(writer, "steps", HADA_U64, 1, groups, err));
    HADA_TRY(each_array(trainer, declare, writer, err));
    HADA_TRY(hada_tensors_write(writer, trainer->progress.group_steps, bytes, err));
    return each_array(trainer, write_array, writer, err);
}

/* The snapshot stays as it is: it holds values that were seen to give finite numbers, these here were not yet. */
hada_status hada_trainer_save(hada_trainer *trainer, const char *path, hada_error *err)
{
    hada_tensors_writer *writer = NULL;
    int finite = 1;
    hada_status status = HADA_OK;
    HADA_NEED(trainer && path, err);
    HADA_TRY_OR_DONE(each_array(trainer, is_finite, &finite, err));
    if (!finite) {
        status = hada_snapshot_restore(&trainer->snapshot, &trainer->workers, &trainer->progress, err);
        trainer->progress.halvings++;
        trainer->progress.bad++;
        HADA_TRY_OR_DONE(status);
    }
    HADA_TRY_OR_DONE(hada_tensors_create(&writer, path, err));
    HADA_TRY_OR_DONE(write_all(trainer, writer, err));
    HADA_TRY_OR_DONE(hada_tensors_finish(&writer, err));
done:
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
    char *net = NULL, *discriminator = NULL, share[32];
    int count;
    const char *format = hada_tensors_meta(file, "format");
    if (!format || strcmp(format, FORMAT))
        return hada_fail(err, HADA_ERROR_FILE_FORMAT, "this is no checkpoint of this version");
    list_facts(trainer, facts, &count);
    hada_status status = HADA_OK;
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(
            check_text(file, facts[i].key, facts[i].what, facts[i].text, strcmp(facts[i].key, "model") != 0, err));
    HADA_TRY_OR_DONE(describe(trainer, &net, &discriminator, err));
    HADA_TRY_OR_DONE(
        check_text(file, "compose", "the share of scenes of several depths", compose_of(trainer, share), 0, err));
    HADA_TRY_OR_DONE(check_text(file, "net", "the net", net, 0, err));
    HADA_TRY_OR_DONE(
        check_text(file, hada_tensors_meta(file, discriminator_word) ? discriminator_word : old_discriminator_word,
                   "the discriminator", discriminator, 0, err));
done:
    HADA_FREE(net, discriminator);
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

static const hada_stored_tensor *find_array(const hada_tensors *file, const array *what)
{
    const hada_stored_tensor *tensor = hada_tensors_find(file, what->name);
    char old[NAME];
    if (tensor || what->group != HADA_GROUP_DISCRIMINATOR)
        return tensor;
    snprintf(old, sizeof old, "%s%s", old_discriminator_word, what->name + strlen(discriminator_word));
    return hada_tensors_find(file, old);
}

/* A step from values that are not finite, or with a mean square below 0, is not finite, and neither is any after it. */
static hada_status check_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    const hada_stored_tensor *tensor = find_array(user, what);
    if (!tensor || tensor->type != HADA_F32 || tensor->bytes != what->count * sizeof(float))
        return damaged(what->name, err);
    const size_t means = trainer->options.rule == HADA_RULE_ADAM ? what->count / 2 : 0,
                 squares = what->content == HADA_CONTENT_STATE ? means : what->count;
    enum { STRETCH = 4096 };
    float values[STRETCH];
    for (size_t first = 0, count; first < what->count; first += count) {
        count = what->count - first < STRETCH ? what->count - first : STRETCH;
        HADA_TRY(hada_tensor_copy_f32(tensor, first, count, values, err));
        for (size_t i = 0; i < count; i++)
            if (!isfinite(values[i]) || (first + i >= squares && values[i] < 0.0f))
                return damaged(what->name, err);
    }
    return HADA_OK;
}

static hada_status read_array(hada_trainer *trainer, const array *what, void *user, hada_error *err)
{
    hada_snapshot *shot = &trainer->snapshot;
    float *to = what->content == HADA_CONTENT_VALUES ? shot->values[what->group] : shot->states[what->group];
    return hada_tensor_copy_f32(find_array(user, what), 0, what->count, to, err);
}

/* Where a checkpoint stands, beside its arrays. */
typedef struct place {
    uint64_t step, place, bad, halvings;
    const hada_stored_tensor *steps;
} place;

/* A checkpoint with more rollbacks is as good as this: the rates are zero. */
enum { MOST_HALVINGS = 1000 };

static hada_status check_file(hada_trainer *trainer, hada_tensors *file, place *at, hada_error *err)
{
    const size_t bytes = (size_t)trainer->workers.groups * sizeof(uint64_t);
    HADA_TRY(check_facts(trainer, file, err));
    HADA_TRY(get_number(file, "step", &at->step, err));
    HADA_TRY(get_number(file, "place", &at->place, err));
    HADA_TRY(get_number(file, "rollbacks", &at->bad, err));
    HADA_TRY(get_number(file, "halvings", &at->halvings, err));
    at->steps = hada_tensors_find(file, "steps");
    if (!at->steps || at->steps->type != HADA_U64 || at->steps->bytes != bytes)
        return damaged("steps", err);
    return each_array(trainer, check_array, file, err);
}

/* Everything is checked before anything changes. */
static hada_status take(hada_trainer *trainer, hada_tensors *file, hada_error *err)
{
    hada_train_progress *progress = &trainer->progress;
    hada_snapshot *snapshot = &trainer->snapshot;
    place at = {0};
    HADA_TRY(check_file(trainer, file, &at, err));
    HADA_TRY(each_array(trainer, read_array, file, err));
    for (int g = 0; g < trainer->workers.groups; g++) {
        HADA_TRY(hada_snapshot_give(snapshot, &trainer->workers, g, err));
        snapshot->dirty[g] = 0;
    }
    memcpy(progress->group_steps, at.steps->data, at.steps->bytes);
    memcpy(snapshot->group_steps, at.steps->data, at.steps->bytes);
    snapshot->step = progress->step = at.step;
    progress->place = at.place;
    progress->bad = at.bad < MOST_HALVINGS ? (int)at.bad : MOST_HALVINGS;
    progress->failed = 0;
    progress->stuck = 0;
    progress->halvings = at.halvings < MOST_HALVINGS ? (int)at.halvings : MOST_HALVINGS;
    hada_feed_destroy(&trainer->feed);
    return HADA_OK;
}

hada_status hada_trainer_load(hada_trainer *trainer, const char *path, hada_error *err)
{
    hada_tensors *file = NULL;
    HADA_NEED(trainer && path, err);
    HADA_TRY(hada_tensors_open(&file, path, err));
    const hada_status status = take(trainer, file, err);
    hada_tensors_close(&file);
    return hada_named(status, path, err);
}
