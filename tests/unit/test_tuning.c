/* The tuning file: rows that are read and honoured, rows that are refused, and the tuner of convolutions, which leaves
 * out what is wrong. */
#include <sys/wait.h>
#include <unistd.h>

#include "net_fixture.h"

#include "net/conv_internal.h"
#include "net/conv_tune.h"
#include "netlist/presets.h"

static char file[64];
enum { IN = 32, OUT = 64, ROWS = 24, COLS = 26 };

static void write_file(const char *text)
{
    FILE *out = fopen(file, "w");
    assert_non_null(out);
    fputs(text, out);
    fclose(out);
}

static hada_status open_with(const char *text, hada_context **context, hada_error *err)
{
    hada_context_options options;
    hada_context_options_init(&options);
    options.tuning = file;
    options.skip_self_test = 1;
    write_file(text);
    return hada_context_create(context, &options, err);
}

static const hada_conv_desc desc = {.images = 1,
                                    .in_channels = IN,
                                    .out_channels = OUT,
                                    .in_rows = ROWS,
                                    .in_cols = COLS,
                                    .kernel_rows = 3,
                                    .kernel_cols = 3,
                                    .stride = 1,
                                    .pad_rows = 1,
                                    .pad_cols = 1,
                                    .activation = HADA_ACTIVATION_RELU};

TEST(wrong_rows_are_refused_by_line)
{
    static const struct {
        const char *row, *word;
    } wrong[] = {
        {"fft cpu 16x16", "OPERATION KIND SHAPE CHOICE"},
        {"nonsense", "OPERATION KIND SHAPE CHOICE"},
        {"sort cpu 16 quick", "operation"},
        {"fft toaster 16x16 own", "kind of device"},
        {"fft cpu 16 own", "shape"},
        {"fft cpu 0x16 own", "shape"},
        {"fft cpu 16x16x16 own", "shape"},
        {"fft cpu 16x16 other", "chooses"},
        {"fft cpu 16x16 own block=8", "option"},
        {"fft cpu 16x16 own own", "word too many"},
        {"conv cpu 3x3/1/1+1:16>16 direct", "shape"},
        {"conv cpu 3x3:16>16:8x8 direct", "shape"},
        {"conv cpu * fft", "chooses"},
        {"conv cpu * direct blocks=two", "number"},
        {"conv cpu * direct blocks=-1", "number"},
        {"conv cpu * direct blocks=1 speed=3", "option"},
        {"conv cpu * direct blocks=99999999999999", "number"},
    };
    for (size_t i = 0; i < HADA_COUNT(wrong); i++) {
        char text[256];
        hada_context *context;
        hada_error error = {0};
        snprintf(text, sizeof text, "# remark\n\nfft cpu 8x8 own\n%s\nfft cpu 8x8 own\n", wrong[i].row);
        assert_int_equal(open_with(text, &context, &error), HADA_ERROR_FILE_FORMAT);
        assert_null(context);
        if (!strstr(error.message, "line 4") || !strstr(error.message, wrong[i].word))
            fail_msg("'%s' gave: %s", wrong[i].row, error.message);
    }
    /* remarks of any length, blanks, a last line without an end */
    char longer[1200];
    hada_context *context;
    memset(longer, 'x', sizeof longer);
    memcpy(longer, "  # ", 4);
    strcpy(longer + 1100, "\n\t\r\nfft * * own");
    ASSERT_OK(open_with(longer, &context, err));
    assert_int_equal(context->tuning->count, 1);
    hada_context_destroy(&context);
    memcpy(longer, "fft ", 4);
    hada_error error = {0};
    assert_int_equal(open_with(longer, &context, &error), HADA_ERROR_FILE_FORMAT);
    assert_non_null(strstr(error.message, "line 1 is too long"));
    remove(file);
}

static void serves(const char *text, const char *expected)
{
    hada_context *context;
    hada_conv_plan plan;
    char words[64];
    ASSERT_OK(open_with(text, &context, err));
    ASSERT_OK(hada_conv_plan_make(&plan, context, &desc, NULL, err));
    hada_conv_choice_text(&plan, HADA_CONV_FORWARD, words, sizeof words);
    assert_string_equal(words, expected);
    hada_context_destroy(&context);
    remove(file);
}

/* Rows for both sizes of blocks: one of them fits the device. */
TEST(rows_are_honoured)
{
    const net_device *device = *state;
    if (device->context->shape == HADA_SHAPE_GROUPS)
        skip();
    const int wide = hada_net_block(device->context) == 16;
    hada_conv_plan plan;
    char shape[64], table[64];
    ASSERT_OK(hada_conv_plan_make(&plan, device->context, &desc, NULL, err));
    hada_conv_shape_text(&plan, HADA_CONV_FORWARD, shape, sizeof shape);
    hada_conv_choice_text(&plan, HADA_CONV_FORWARD, table, sizeof table);
    assert_string_equal(shape, "3x3/1/1+1:32>64:24x26");
    serves("conv * 3x3/1/1+1:32>64:24x26 direct block=16 blocks=1 pixels=8 rows=3\n"
           "conv * 3x3/1/1+1:32>64:24x26 direct block=8 blocks=1 pixels=6 rows=3\n",
           wide ? "direct block=16 blocks=1 pixels=8 rows=3" : "direct block=8 blocks=1 pixels=6 rows=3");
    serves("conv * 3x3/1/1+1:32>64:* winograd4 blocks=1 tiles=12\n",
           wide ? "winograd4 block=16 blocks=1 tiles=12" : "winograd4 block=8 blocks=1 tiles=12");
    serves("conv * * winograd2 tiles=12\n",
           wide ? "winograd2 block=16 blocks=2 tiles=12" : "winograd2 block=8 blocks=2 tiles=12");
    serves("conv * * winograd4 tiles=12\nconv * * plain\n", "plain"); /* the last one wins */
    /* other kinds, shapes and blocks leave the table's */
    serves("conv gpu * plain\n", device->context->info.kind == HADA_DEVICE_GPU ? "plain" : table);
    serves("conv * 3x3/1/1+1:32>64:24x27 plain\nconv * 3x3/1/2+1:* plain\nconv * * plain block=4\n", table);
    /* a description that names a method itself is obeyed */
    hada_context *context;
    hada_conv_desc plain = desc;
    plain.method = HADA_CONV_PLAIN;
    ASSERT_OK(open_with("conv * * direct\n", &context, err));
    ASSERT_OK(hada_conv_plan_make(&plan, context, &plain, NULL, err));
    assert_int_equal(plan.pass[HADA_CONV_FORWARD].method, HADA_CONV_PLAIN);
    hada_context_destroy(&context);
    remove(file);
}

TEST(rows_that_cannot_serve_are_refused_by_line)
{
    const net_device *device = *state;
    if (device->context->shape == HADA_SHAPE_GROUPS)
        skip();
    static const char *const wrong[] = {
        "direct blocks=2 pixels=5", "direct blocks=1",      "direct pixels=8",  "direct tiles=12", "direct rows=0",
        "winograd4 tiles=13",       "winograd4 tiles=1200", "winograd4 rows=2", "winograd2",       "winograd2 tiles=0",
        "winograd4 blocks=3",       "plain blocks=1",
    };
    for (size_t i = 0; i < HADA_COUNT(wrong); i++) {
        char text[128];
        hada_context *context;
        hada_conv_plan plan;
        hada_error error = {0};
        snprintf(text, sizeof text, "# one\nconv * 3x3/1/1+1:32>64:* %s\n", wrong[i]);
        ASSERT_OK(open_with(text, &context, err));
        if (hada_conv_plan_make(&plan, context, &desc, NULL, &error) != HADA_ERROR_UNSUPPORTED ||
            !strstr(error.message, "line 2"))
            fail_msg("'%s' gave: %s", wrong[i], error.message);
        hada_context_destroy(&context);
    }
    /* the error reaches whoever makes a net ready */
    hada_context *context;
    hada_net *net;
    hada_net_runner *runner;
    hada_error error = {0};
    ASSERT_OK(open_with("conv * * winograd4 tiles=12\n", &context, err)); /* its last kernel is 1 x 1 */
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    assert_int_equal(hada_net_runner_create(&runner, context, net, 32, 32, &error), HADA_ERROR_UNSUPPORTED);
    assert_non_null(strstr(error.message, "line 1"));
    hada_net_destroy(&net);
    hada_context_destroy(&context);
    remove(file);
}

static hada_tune_conv_row small_row(void)
{
    return (hada_tune_conv_row){
        .in_channels = IN, .out_channels = OUT, .in_rows = ROWS, .in_cols = COLS, .kernel = 3, .stride = 1, .pad = 1};
}

typedef struct seen {
    int spoilt, count;
    const char *spoil; /* variants that begin so give a wrong value */
    float value;
} seen;

static void look(void *user, const char *variant, float *values, size_t count)
{
    seen *s = user;
    s->count++;
    if (strncmp(variant, s->spoil, strlen(s->spoil)))
        return;
    s->spoilt++;
    values[count / 2 + 3] = s->value;
}

/* One wrong value of one variant is enough, as is one that is no number. */
TEST(wrong_variants_are_left_out)
{
    const net_device *device = *state;
    static const float values[] = {17.0f, NAN};
    for (size_t i = 0; i < HADA_COUNT(values); i++) {
        hada_tune_conv_row row = small_row();
        seen s = {.spoil = "winograd", .value = values[i]};
        ASSERT_OK(hada_conv_tune(device->slot, &row, 100, look, &s, err));
        assert_int_equal(row.refused, s.spoilt);
        assert_int_equal(row.measured, s.count - s.spoilt);
        assert_true(row.measured > 0);
        assert_int_equal(strncmp(row.chosen, "winograd", 8) != 0, 1);
        if (device->context->shape == HADA_SHAPE_LANES) {
            assert_true(s.spoilt > 0);
            assert_non_null(strstr(row.reason, "relative difference"));
        }
    }
    hada_tune_conv_row row = small_row();
    hada_error error = {0};
    seen s = {.spoil = "", .value = 17.0f};
    assert_int_equal(hada_conv_tune(device->slot, &row, 100, look, &s, &error), HADA_ERROR_SELF_TEST);
    assert_int_equal(row.refused, s.count);
}

TEST(nothing_is_wrong_by_itself)
{
    const net_device *device = *state;
    hada_tune_conv_row row = small_row();
    seen s = {.spoil = "none"};
    ASSERT_OK(hada_conv_tune(device->slot, &row, 100, look, &s, err));
    assert_int_equal(row.refused, 0);
    assert_string_equal(row.shape, "3x3/1/1+1:32>64:24x26");
    assert_true(row.chosen_ms > 0 && row.chosen_ms <= row.before_ms);
    /* no time: what serves is measured all the same, and stays */
    ASSERT_OK(hada_conv_tune(device->slot, &row, 1e-6, look, &s, err));
    assert_int_equal(row.measured, 1);
    assert_true(row.skipped > 0);
    assert_string_equal(row.chosen, row.before);
    assert_int_equal(hada_tune_conv(device->context, &row, 0, NULL), HADA_ERROR_ARGUMENT);
}

/* Each variant, written to a file and read by a context of its own, is what it was, and gives the same values. */
TEST(variants_survive_the_file)
{
    const net_device *device = *state;
    hada_conv_plan plan;
    hada_conv_choice choices[HADA_CONV_VARIANTS];
    ASSERT_OK(hada_conv_plan_make(&plan, device->context, &desc, NULL, err));
    const int count = hada_conv_variants(device->context, &plan, choices);
    assert_true(count > 0);
    remove(file);
    for (int i = 0; i < count; i++) {
        hada_conv_plan forced, read;
        hada_tune_conv_row row = small_row();
        hada_context *context;
        hada_context_options options;
        char again[64];
        if (hada_conv_plan_make(&forced, device->context, &desc, &choices[i], NULL))
            continue;
        hada_conv_shape_text(&forced, HADA_CONV_FORWARD, row.shape, sizeof row.shape);
        hada_conv_choice_text(&forced, HADA_CONV_FORWARD, row.chosen, sizeof row.chosen);
        ASSERT_OK(hada_tune_save_convs(device->context, file, &row, 1, err));
        hada_context_options_init(&options);
        options.tuning = file;
        options.skip_self_test = 1;
        ASSERT_OK(hada_context_create(&context, &options, err));
        assert_int_equal(context->tuning->count, 1); /* brought up to date, not added to */
        ASSERT_OK(hada_conv_plan_make(&read, context, &desc, NULL, err));
        hada_conv_choice_text(&read, HADA_CONV_FORWARD, again, sizeof again);
        assert_string_equal(again, row.chosen);
        hada_context_destroy(&context);
    }
    remove(file);
}

/* A net under a file of other choices gives the same image within the stated errors. */
TEST(a_tuned_net_gives_the_same)
{
    const net_device *device = *state;
    enum { SIZE = 48 };
    hada_net *net;
    hada_context *context;
    hada_image in, out[2] = {{0}};
    ASSERT_OK(hada_net_create_preset(&net, "compact", 3, 1, err));
    ASSERT_OK(hada_image_create(&in, 3, SIZE, SIZE, err));
    net_fill(in.data, hada_image_count(&in), 1);
    ASSERT_OK(open_with("conv * 3x3/1/1+1:* direct\nconv * 1x1/1/1+0:* plain\n", &context, err));
    for (int i = 0; i < 2; i++) {
        hada_net_runner *runner;
        ASSERT_OK(hada_net_runner_create(&runner, i ? context : device->context, net, SIZE, SIZE, err));
        ASSERT_OK(hada_net_run(runner, &in, &out[i], err));
        hada_net_runner_destroy(&runner);
    }
    double square = 0, whole = 0;
    for (size_t k = 0; k < hada_image_count(&out[0]); k++) {
        const double a = out[0].data[k], b = out[1].data[k];
        square += (a - b) * (a - b);
        whole += a * a;
    }
    assert_true(whole > 0 && sqrt(square / whole) < 2e-5);
    hada_tune_conv_row *rows;
    size_t count;
    int layers = 0;
    ASSERT_OK(hada_tune_net(context, net, SIZE, SIZE, &rows, &count, err));
    for (size_t i = 0; i < count; i++)
        layers += rows[i].layers;
    assert_int_equal(count, 15);
    assert_int_equal(layers, 19);
    assert_string_equal(rows[count - 1].before, "plain"); /* as the file says */
    hada_tune_convs_destroy(&rows);
    hada_net_destroy(&net);
    hada_image_destroy(&in);
    hada_image_destroy(&out[0]);
    hada_image_destroy(&out[1]);
    hada_context_destroy(&context);
    remove(file);
}

/* Two tuners that write one file at once lose no row of each other. */
TEST(rows_of_two_processes_all_stay)
{
    enum { ROWS_EACH = 25, PROCESSES = 2 };
    pid_t child[PROCESSES];
    hada_context *context;
    hada_error error = {0};
    int count = 0, result;
    ASSERT_OK(open_with("", &context, &error));
    for (int p = 0; p < PROCESSES; p++) {
        child[p] = fork();
        for (int i = 0; !child[p] && i < ROWS_EACH; i++) {
            char shape[32];
            snprintf(shape, sizeof shape, "%dx%d", 8 + p, 8 + i);
            const char *const shapes[] = {shape}, *const choices[] = {"own"};
            if (hada_tuning_write(context, file, "fft", shapes, choices, 1, &error))
                _exit(1);
        }
        if (!child[p])
            _exit(0);
    }
    for (int p = 0; p < PROCESSES; p++)
        assert_true(waitpid(child[p], &result, 0) == child[p] && WIFEXITED(result) && !WEXITSTATUS(result));
    FILE *in = fopen(file, "r");
    char line[256];
    assert_non_null(in);
    while (fgets(line, sizeof line, in))
        count += !strncmp(line, "fft ", 4);
    fclose(in);
    assert_int_equal(count, PROCESSES * ROWS_EACH);
    hada_context_destroy(&context);
    remove(file);
}

static int set_up(void **state)
{
    snprintf(file, sizeof file, "/tmp/hadalens-tuning-%ld", (long)getpid());
    return net_device_open(state);
}

FIXTURE(set_up, net_device_close)
