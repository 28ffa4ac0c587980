/* The tuning file: rows that are read, rows that are refused, rows of several writers. */
#include <sys/wait.h>

#include "net_fixture.h"

#include "runtime/tuning.h"

static char file[64];

static hada_status open_with(const char *text, hada_context **context, hada_error *err)
{
    DEFAULTS(hada_context_options, options);
    options.tuning = file;
    options.skip_self_test = 1;
    write_whole_text(file, text);
    return hada_context_create(context, &options, err);
}

TEST(wrong_rows_are_refused_by_line)
{
    static const struct {
        const char *row, *word;
    } wrong[] = {
        {"fft cpu 16x16", "OPERATION KIND SHAPE CHOICE"},
        {"nonsense", "OPERATION KIND SHAPE CHOICE"},
        {"sort cpu 16 quick", "operation"},
        {"conv cpu * direct", "operation"}, /* rows of 0.1.0 */
        {"fft toaster 16x16 own", "kind of device"},
        {"fft cpu 16 own", "shape"},
        {"fft cpu 0x16 own", "shape"},
        {"fft cpu 16x16x16 own", "shape"},
        {"fft cpu 16x16 other", "unknown choice"},
        {"fft cpu 16x16 own block=8", "word too many"},
        {"fft cpu 16x16 own own", "word too many"},
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
    ASSERT_FAILS(open_with(longer, &context, err), HADA_ERROR_FILE_FORMAT, "line 1 is too long");
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
            if (hada_tuning_write(context, file, shapes, choices, 1, &error))
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
