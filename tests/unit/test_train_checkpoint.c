/* Checkpoints: training goes on with the same bits, and what does not fit is refused. */
#include "testing.h"

#include "trainer_fixture.h"

TEST(going_on_gives_the_same_bits)
{
    for (int devices = 1; devices <= 2; devices++)
        for (size_t s = 0; s < HADA_COUNT(all_stages); s++) {
            const hada_stage stage = all_stages[s];
            hada_train_options options = options_of(stage);
            augment.noise = 0.01;
            augment.exposure = 0.1;
            SCOPED(hada_trainer) *trainer = make(&options, devices);
            steps(trainer, 6);
            save(trainer, 0);
            hada_trainer_destroy(&trainer);
            trainer = make(&options, devices);
            steps(trainer, 3);
            save(trainer, 1);
            assert_false(same_files());
            hada_trainer_destroy(&trainer);
            trainer = make(&options, devices);
            steps(trainer, 1); /* loading leaves nothing of it */
            ASSERT_OK(hada_trainer_load(trainer, f.path[1], err));
            assert_int_equal(trainer->progress.step, 3);
            steps(trainer, 3);
            save(trainer, 1);
            assert_true(same_files());
        }
}

/* Optimizer states are kept on the devices that update their values; files hold them whole, for any number of devices.
 */
TEST(devices_may_be_more_or_fewer)
{
    static const hada_stage stages[] = {HADA_STAGE_FILTERS, HADA_STAGE_ADVERSARIAL};
    for (size_t i = 0; i < HADA_COUNT(stages); i++) {
        const hada_train_options options = options_of(stages[i]);
        SCOPED(hada_trainer) *one = make(&options, 1), *two = make(&options, 2);
        steps(two, 4);
        save(two, 0);
        ASSERT_OK(hada_trainer_load(one, f.path[0], err));
        assert_int_equal(one->progress.step, 4);
        save(one, 1);
        assert_true(same_files());
        steps(one, 2);
        save(one, 1);
        ASSERT_OK(hada_trainer_load(two, f.path[1], err));
        save(two, 0);
        assert_true(same_files());
        for (int group = HADA_GROUP_NET; group <= HADA_GROUP_DISCRIMINATOR; group++) {
            const size_t all =
                hada_parameters_floats(hada_worker_parameters(one->workers.worker), group, HADA_CONTENT_GRADIENT);
            const hada_part whole = hada_worker_parameters(one->workers.worker)->group[group].part;
            const hada_part first = hada_worker_parameters(&two->workers.worker[0])->group[group].part;
            const hada_part second = hada_worker_parameters(&two->workers.worker[1])->group[group].part;
            assert_true(whole.first == 0 && whole.count == all && first.first == 0);
            assert_true(second.first == first.count && first.count + second.count == all);
            assert_true(!all || (first.count > all / 3 && second.count > all / 3));
        }
    }
}

TEST(fewer_filters_at_once_give_the_same_bits)
{
    for (int i = 0; i < 2; i++) {
        hada_train_options options = options_of(HADA_STAGE_FILTERS);
        options.at_once = i ? 1 : 4;
        SCOPED(hada_trainer) *trainer = make(&options, 1);
        steps(trainer, 4);
        save(trainer, i);
    }
    assert_true(same_files());
}

TEST(checkpoints_of_others_are_refused)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE), other;
    SCOPED(hada_trainer) *trainer = make(&options, 1);
    hada_error error = {0};
    steps(trainer, 1);
    save(trainer, 0);
    hada_trainer_destroy(&trainer);
    for (int kind = 0; kind < 6; kind++) {
        static const char *const words[] = {"the stage is enhance there and conventional here",
                                            "the seed is 1 there and 2 here",
                                            "the batch is 4 there and 3 here",
                                            "the rule is adam there and rmsprop here",
                                            "the net differs",
                                            "depths, channels and sizes"};
        other = options_of(kind == 0 ? HADA_STAGE_CONVENTIONAL : HADA_STAGE_ENHANCE);
        other.seed += kind == 1;
        other.batch -= kind == 2;
        other.rule = kind == 3 ? HADA_RULE_RMSPROP : HADA_RULE_ADAM;
        other.net_given = kind == 4 ? NULL : f.net;
        if (kind == 5) {
            other = options_of(HADA_STAGE_FILTERS);
            other.form = HADA_FORM_SPLIT;
            trainer = make(&other, 1);
            save(trainer, 1);
            hada_trainer_destroy(&trainer);
            other.form = HADA_FORM_COMPLEX;
        }
        trainer = make(&other, 1);
        assert_int_equal(hada_trainer_load(trainer, f.path[kind == 5], &error), HADA_ERROR_MODEL);
        assert_non_null(strstr(error.message, words[kind]));
        assert_non_null(strstr(error.message, f.path[kind == 5]));
        assert_int_equal(trainer->progress.step, 0);
        steps(trainer, 1);
        hada_trainer_destroy(&trainer);
    }
    /* the same sizes, but another camera */
    SCOPED(hada_model) * flat;
    hada_train_options filters = options_of(HADA_STAGE_FILTERS);
    filters.form = HADA_FORM_COMPLEX;
    trainer = make(&filters, 1);
    save(trainer, 0);
    ASSERT_OK(hada_trainer_model(trainer, &flat, err));
    steps(trainer, 1);
    hada_model_destroy(&flat);
    ASSERT_OK(hada_trainer_model(trainer, &flat, err));
    hada_trainer_destroy(&trainer);
    ASSERT_OK(hada_trainer_create(&trainer, &f.whole, 1, flat, pairs, NULL, &filters, err));
    ASSERT_FAILS(hada_trainer_load(trainer, f.path[0], err), HADA_ERROR_MODEL, "filters differs");
}

TEST(damaged_checkpoints_are_refused)
{
    hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    SCOPED(hada_trainer) *trainer = make(&options, 1);
    hada_error error = {0};
    steps(trainer, 1);
    save(trainer, 0);
    FILE *file = fopen(f.path[0], "r+b");
    assert_non_null(file);
    assert_int_equal(ftruncate(fileno(file), 2000), 0);
    fclose(file);
    assert_int_not_equal(hada_trainer_load(trainer, f.path[0], &error), HADA_OK);
    ASSERT_OK(hada_net_save(f.net, f.path[0], err));
    assert_int_equal(hada_trainer_load(trainer, f.path[0], &error), HADA_ERROR_FILE_FORMAT);
    assert_int_equal(hada_trainer_load(trainer, "/nowhere/at/all", &error), HADA_ERROR_FILE_OPEN);
    assert_int_equal(hada_trainer_save(trainer, "/nowhere/at/all", &error), HADA_ERROR_FILE_WRITE);
    assert_int_equal(trainer->progress.step, 1);
    steps(trainer, 1);
}

/* Replaces a number of an array, the last one or the first, in a checkpoint. */
static void spoil(const char *path, const char *name, int last, float value)
{
    FILE *file = fopen(path, "r+b");
    uint64_t bytes;
    size_t first, end;
    assert_non_null(file);
    assert_int_equal(fread(&bytes, sizeof bytes, 1, file), 1);
    SCOPED_MEMORY char *header = calloc(bytes + 1, 1);
    char quoted[64];
    assert_int_equal(fread(header, 1, bytes, file), bytes);
    snprintf(quoted, sizeof quoted, "\"%s\"", name);
    const char *at = strstr(header, quoted);
    assert_non_null(at);
    assert_int_equal(sscanf(strstr(at, "data_offsets"), "data_offsets\":[%zu,%zu]", &first, &end), 2);
    fseek(file, (long)(sizeof bytes + bytes + (last ? end - sizeof value : first)), SEEK_SET);
    assert_int_equal(fwrite(&value, sizeof value, 1, file), 1);
    fclose(file);
}

/* Numbers from which no step is finite: training would go back and on for ever. */
TEST(numbers_that_no_step_leads_to_are_refused)
{
    static const struct {
        const char *name;
        int last, refused;
        float value;
    } rows[] = {{"net.values", 0, 1, NAN},     {"net.values", 1, 1, INFINITY}, {"net.state", 0, 1, NAN},
                {"net.state", 1, 1, NAN},      {"net.state", 1, 1, -1e-3f},    {"net.state", 0, 0, -1e-3f},
                {"net.state", 1, 1, -INFINITY}};
    const hada_train_options options = options_of(HADA_STAGE_ENHANCE);
    for (size_t i = 0; i < HADA_COUNT(rows); i++) {
        SCOPED(hada_trainer) *trainer = make(&options, 1);
        steps(trainer, 1);
        save(trainer, 0);
        spoil(f.path[0], rows[i].name, rows[i].last, rows[i].value);
        if (rows[i].refused)
            ASSERT_FAILS(hada_trainer_load(trainer, f.path[0], err), HADA_ERROR_FILE_FORMAT, rows[i].name);
        else
            ASSERT_OK(hada_trainer_load(trainer, f.path[0], err));
        steps(trainer, 1); /* it is as it was, or goes on */
    }
}

/* Writes the header of a checkpoint as 0.1.0 did: it is shorter, and ends with spaces. */
static void rename_discriminator(const char *path)
{
    static const char now[] = "discriminator", before[] = "critic";
    FILE *file = fopen(path, "r+b");
    uint64_t bytes;
    int found = 0;
    assert_non_null(file);
    assert_int_equal(fread(&bytes, sizeof bytes, 1, file), 1);
    SCOPED_MEMORY char *header = calloc(bytes + 1, 1);
    char *to = header;
    assert_int_equal(fread(header, 1, bytes, file), bytes);
    for (const char *from = header; *from;) {
        const int here = !strncmp(from, now, strlen(now));
        found += here;
        if (here) {
            memcpy(to, before, strlen(before));
            to += strlen(before);
            from += strlen(now);
        } else {
            *to++ = *from++;
        }
    }
    memset(to, ' ', (size_t)(header + bytes - to));
    assert_true(found == 3); /* the net, its values, their optimiser's state */
    assert_int_equal(fseek(file, sizeof bytes, SEEK_SET), 0);
    assert_int_equal(fwrite(header, 1, bytes, file), bytes);
    fclose(file);
}

TEST(checkpoints_of_older_versions_go_on)
{
    const hada_train_options options = options_of(HADA_STAGE_ADVERSARIAL);
    SCOPED(hada_trainer) *trainer = make(&options, 1);
    steps(trainer, 2);
    save(trainer, 0);
    save(trainer, 1);
    rename_discriminator(f.path[1]);
    assert_false(same_files());
    hada_trainer_destroy(&trainer);
    trainer = make(&options, 1);
    ASSERT_OK(hada_trainer_load(trainer, f.path[1], err));
    save(trainer, 1);
    assert_true(same_files());
}

FIXTURE(setup, teardown)
