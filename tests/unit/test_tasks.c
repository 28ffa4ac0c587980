/* Tasks, whatever they work on: how they report progress and messages, and what is left when they are stopped at any
 * moment. On a camera so small that a run takes a blink. */
#include "testing.h"

enum { DEPTHS = 2, PAIRS = 2, TESTS = 1 };

static hada_context *context;
static hada_camera camera;
static char root[200];

/* Who listens to a task, and stops it the stop_at-th time that it asks; 0: never. */
typedef struct listener {
    hada_monitor monitor;
    int asked, stop_at;
    int runs, steps, wrong; /* stretches of progress; what breaks the rules of monitor.h */
    long total;             /* of the last stretch */
    char what[80];          /* of the stretch that runs; "" between two */
    char last[80], notes[2000];
} listener;

static void progress(void *user, const char *what, long done, long total, const char *note)
{
    listener *to = user;
    (void)note;
    if (!what) {
        to->wrong += !*to->what;
        *to->what = '\0';
    } else if (!done) {
        to->wrong += *to->what != '\0';
        snprintf(to->what, sizeof to->what, "%s", what);
        snprintf(to->last, sizeof to->last, "%s", what);
        to->runs++;
        to->steps = 0;
        to->total = total;
    } else {
        to->wrong += strcmp(what, to->what) || done != ++to->steps || total != to->total || (total && done > total);
    }
}

static void message(void *user, hada_message kind, const char *text)
{
    listener *to = user;
    to->wrong += kind < HADA_MESSAGE_NOTE || kind > HADA_MESSAGE_DETAIL || !*text;
    if (kind == HADA_MESSAGE_NOTE && strlen(to->notes) + strlen(text) + 2 < sizeof to->notes)
        strcat(strcat(to->notes, text), "\n");
}

static int cancelled(void *user)
{
    listener *to = user;
    return ++to->asked == to->stop_at;
}

static listener *listen(listener *to, int stop_at)
{
    *to = (listener){.stop_at = stop_at};
    hada_monitor_init(&to->monitor);
    to->monitor.user = to;
    to->monitor.progress = progress;
    to->monitor.message = message;
    to->monitor.cancelled = cancelled;
    return to;
}

static const char *at(const char *name)
{
    return path_below(root, name);
}

static int exists(const char *path)
{
    struct stat unused;
    return !lstat(path, &unused);
}

/* A task as the tests run it; what it writes is called "out", below root. */
typedef hada_status (*task)(const hada_monitor *monitor, hada_error *err);

static hada_status scan(hada_dataset **data, hada_error *err)
{
    return hada_dataset_scan(data, at("set"), NULL, err);
}

static hada_status simulate_into(const char *folder, const hada_monitor *monitor, hada_error *err)
{
    DEFAULTS(hada_simulate_task, own);
    own.pairs = PAIRS;
    own.tests = TESTS;
    own.monitor = monitor;
    return hada_simulate_run(context, &camera, folder, &own, NULL, err);
}

static hada_status simulate(const hada_monitor *monitor, hada_error *err)
{
    return simulate_into(at("out"), monitor, err);
}

static hada_status optics(const hada_monitor *monitor, hada_error *err)
{
    DEFAULTS(hada_optics_task, own);
    own.monitor = monitor;
    return hada_optics_run(NULL, context, &camera, at("out"), &own, err);
}

static hada_status fit(const hada_monitor *monitor, hada_error *err)
{
    SCOPED(hada_dataset) * data;
    SCOPED(hada_model) *model = NULL;
    SCOPED(hada_fit_report) *report = NULL;
    hada_status status = scan(&data, err);
    assert_int_equal(status, HADA_OK);
    DEFAULTS(hada_fit_task, own);
    own.save_sums = at("out");
    own.monitor = monitor;
    status = hada_fit_run(&model, &report, context, data, &own, err);
    assert_true(!status == !!model && !status == !!report);
    if (!status)
        for (int z = 0; z < DEPTHS; z++)
            assert_int_equal(report->pairs[z], PAIRS);
    return status;
}

static hada_status register_set(const hada_monitor *monitor, hada_error *err)
{
    SCOPED(hada_dataset) * data;
    SCOPED(hada_register_report) *report = NULL;
    hada_status status = scan(&data, err);
    assert_int_equal(status, HADA_OK);
    DEFAULTS(hada_register_task, own);
    own.monitor = monitor;
    status = hada_register_run(&report, data, &own, err);
    assert_true(!status == !!report);
    if (!status)
        status = hada_register_write(report, data, at("out"), &own, NULL, NULL, err);
    return status;
}

static const struct {
    const char *name;
    task run;
    const char *what; /* of its last stretch of progress, */
    long total;       /* and how long that is; -1: depends */
} tasks[] = {{"simulate", simulate, "frames", DEPTHS *PAIRS + TESTS},
             {"optics", optics, "depths", DEPTHS},
             {"fit", fit, "pairs", -1},
             {"register", register_set, "pairs", DEPTHS *PAIRS}};

TEST(progress_is_counted_to_its_end)
{
    for (size_t i = 0; i < sizeof tasks / sizeof *tasks; i++) {
        listener ear;
        ASSERT_OK(tasks[i].run(&listen(&ear, 0)->monitor, err));
        if (ear.wrong || !ear.runs || *ear.what || !ear.asked)
            fail_msg("%s: %d calls against the rules, %d stretches, '%s' goes on, asked %d times", tasks[i].name,
                     ear.wrong, ear.runs, ear.what, ear.asked);
        if (tasks[i].total >= 0) {
            assert_string_equal(ear.last, tasks[i].what);
            assert_int_equal(ear.total, tasks[i].total);
            assert_int_equal(ear.steps, tasks[i].total);
        }
        assert_true(exists(at("out")));
        hada_folder_remove(at("out"));
        unlink(at("out"));
    }
}

/* Stopped the first, second, ... time that it asks: always HADA_ERROR_CANCELLED, soon, and nothing is written. */
TEST(stopped_at_any_moment_nothing_is_left)
{
    for (size_t i = 0; i < sizeof tasks / sizeof *tasks; i++) {
        listener ear;
        hada_error error = {0};
        ASSERT_OK(tasks[i].run(&listen(&ear, 0)->monitor, err));
        const int times = ear.asked;
        for (int stop = 1; stop <= times; stop += times > 12 ? times / 12 : 1) {
            hada_folder_remove(at("out"));
            unlink(at("out"));
            const hada_status status = tasks[i].run(&listen(&ear, stop)->monitor, &error);
            if (status != HADA_ERROR_CANCELLED || ear.asked != stop || *ear.what || ear.wrong)
                fail_msg("%s stopped at %d of %d: %s, asked %d times, '%s' goes on", tasks[i].name, stop, times,
                         hada_status_name(status), ear.asked, ear.what);
            /* sums are saved when the first pass is done: all of them or none */
            if (tasks[i].run != fit)
                assert_false(exists(at("out")));
        }
        hada_folder_remove(at("out"));
        unlink(at("out"));
    }
}

/* Sums of nothing make no model, whatever reconstruct would say of it later. */
TEST(sums_of_nothing_make_no_model)
{
    listener ear;
    SCOPED(hada_model) *model = NULL;
    DEFAULTS(hada_fit_task, own);
    static char text[16384], path[600];
    const char *const merged[] = {path};
    uint64_t header;
    size_t first, end;
    snprintf(path, sizeof path, "%s", at("out"));
    ASSERT_OK(fit(&listen(&ear, 0)->monitor, err)); /* saves sums */
    FILE *file = fopen(path, "r+b");
    assert_non_null(file);
    assert_int_equal(fread(&header, sizeof header, 1, file), 1);
    assert_true(header < sizeof text && fread(text, 1, header, file) == header);
    const char *sums = strstr(text, "\"sums\"");
    assert_non_null(sums);
    assert_int_equal(sscanf(strstr(sums, "data_offsets"), "data_offsets\":[%zu,%zu]", &first, &end), 2);
    fseek(file, (long)(sizeof header + header + first), SEEK_SET);
    for (size_t i = first; i < end; i++)
        fputc(0, file);
    fclose(file);
    own.merge = merged;
    own.merge_count = 1;
    const hada_status status = hada_fit_run(&model, NULL, context, NULL, &own, NULL);
    assert_true(status == HADA_ERROR_MODEL || status == HADA_ERROR_NUMERIC);
    assert_null(model);
    remove(path);
}

/* Callbacks are optional one by one, and a caller whose monitor ends before one of them does not have it. */
TEST(nobody_has_to_listen)
{
    listener ear;
    hada_monitor_init(&listen(&ear, 1)->monitor);
    ASSERT_OK(simulate(&ear.monitor, err));
    hada_folder_remove(at("out"));
    listen(&ear, 1)->monitor.size = offsetof(hada_monitor, cancelled);
    ASSERT_OK(simulate(&ear.monitor, err));
    assert_true(ear.asked == 0 && ear.runs == 1);
    hada_folder_remove(at("out"));
}

TEST(notes_say_what_was_passed_over)
{
    listener ear;
    SCOPED(hada_evaluate_report) *report = NULL;
    DEFAULTS(hada_evaluate_task, own);
    own.monitor = &listen(&ear, 0)->monitor;
    ASSERT_OK(hada_folder_ensure(at("results"), err));
    char name[300], truth[300];
    SCOPED(hada_dataset) * data;
    SCOPED(hada_image) raw, scene;
    ASSERT_OK(scan(&data, err));
    ASSERT_OK(hada_dataset_read(data, 0, 0, &raw, &scene, err));
    snprintf(name, sizeof name, "results%s", strrchr(hada_dataset_get_info(data)->files[0][0].scene, '/'));
    snprintf(truth, sizeof truth, "%s/scene", hada_dataset_get_info(data)->folders[0]);
    ASSERT_OK(hada_tiff_save(at(name), &scene, NULL, err));
    ASSERT_OK(hada_evaluate_run(&report, at("results"), truth, &own, err));
    assert_int_equal(hada_evaluate_report_count(report), 1);
    assert_int_equal(ear.wrong, 0);
    assert_non_null(strstr(ear.notes, "1 file in "));
    assert_non_null(strstr(ear.notes, "without a result in "));
}

static int begin(void **state)
{
    (void)state;
    const char *folder = getenv("TMPDIR");
    hada_error error = {0};
    snprintf(root, sizeof root, "%s/hadalens-tasks-XXXXXX", folder ? folder : P_tmpdir);
    ASSERT_OK(hada_context_create(&context, NULL, err));
    camera.size = sizeof camera;
    ASSERT_OK(hada_camera_preset(&camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&camera, 48, 60, 16, 20, err));
    ASSERT_OK(hada_camera_set_depths(&camera, 100, 400, DEPTHS, err));
    camera.aperture_mm = 4;
    camera.lenses = 3;
    camera.minimum_spacing_mm = 0.8;
    camera.maximum_spacing_mm = 0;
    return !mkdtemp(root) || simulate_into(at("set"), NULL, &error);
}

static int end(void **state)
{
    (void)state;
    hada_context_destroy(&context);
    hada_folder_remove(root);
    return 0;
}

FIXTURE(begin, end)
