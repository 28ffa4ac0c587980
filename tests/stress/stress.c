/* The driver: forms, the table, and what groups share. */
#include "stress.h"

enum { ROWS_AT_MOST = 512 };
typedef struct row {
    char text[112];
    const char *rule;
    double error, bound;
} row;

stress_form stress_form_now = STRESS_BRIEF;
static row rows[ROWS_AT_MOST];
static size_t row_count, group_first;

static int passed(const row *r)
{
    return r->error <= r->bound;
}

static void add(const char *rule, double error, double bound, const char *format, va_list words)
{
    assert_true(row_count < ROWS_AT_MOST);
    row *r = &rows[row_count++];
    r->rule = rule;
    r->error = error;
    r->bound = bound;
    vsnprintf(r->text, sizeof r->text, format, words);
}

void stress_row(const char *rule, double error, double bound, const char *format, ...)
{
    va_list words;
    va_start(words, format);
    add(rule, error, bound, format, words);
    va_end(words);
}

void stress_none(const char *rule, size_t count, const char *format, ...)
{
    va_list words;
    va_start(words, format);
    add(rule, (double)count, 0.0, format, words);
    va_end(words);
}

void stress_end_group(void)
{
    size_t failures = 0;
    for (; group_first < row_count; group_first++)
        failures += !passed(&rows[group_first]);
    if (failures)
        fail_msg("%zu conditions failed", failures);
}

stress_device stress_open(void)
{
    stress_device device = {0};
    cl_device_fp_config config = 0;
    ASSERT_OK(hada_context_create(&device.context, NULL, err));
    ASSERT_OK(hada_slot_create(&device.slot, device.context, err));
    clGetDeviceInfo(device.context->device, CL_DEVICE_SINGLE_FP_CONFIG, sizeof config, &config, NULL);
    device.denormals = (config & CL_FP_DENORM) != 0;
    return device;
}

void stress_close(stress_device *device)
{
    hada_slot_destroy(&device->slot);
    assert_int_equal(hada_context_bytes(device->context), 0);
    hada_context_destroy(&device->context);
}

void *stress_memory(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);
    return p;
}

void stress_fill_normal(float *to, size_t count, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 1);
    for (size_t i = 0; i < count; i++)
        to[i] = (float)hada_random_normal(&random);
}

void stress_fill_uniform(float *to, size_t count, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 2);
    for (size_t i = 0; i < count; i++)
        to[i] = (float)hada_random_uniform(&random);
}

void stress_fill_range(float *to, size_t count, uint64_t seed)
{
    hada_random random;
    hada_random_seed(&random, seed, 3);
    for (size_t i = 0; i < count; i++)
        to[i] = (float)pow(10.0, 12.0 * hada_random_uniform(&random));
}

double stress_norm(const float *values, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (double)values[i] * values[i];
    return sqrt(sum);
}

double stress_norm_double(const double *values, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += values[i] * values[i];
    return sqrt(sum);
}

double stress_distance(const float *got, const double *want, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += (got[i] - want[i]) * (got[i] - want[i]);
    return sqrt(sum);
}

size_t stress_not_finite(const float *values, size_t count)
{
    size_t bad = 0;
    for (size_t i = 0; i < count; i++)
        bad += !isfinite(values[i]);
    return bad;
}

static void print_table(void)
{
    printf("| Condition | Error | Bound | By | Verdict |\n|---|---|---|---|---|\n");
    for (size_t i = 0; i < row_count; i++)
        printf("| %s | %.2g | %.2g | %s | %s |\n", rows[i].text, rows[i].error, rows[i].bound, rows[i].rule,
               passed(&rows[i]) ? "pass" : "FAIL");
}

/* For programs: the condition last. */
static void print_csv(FILE *to)
{
    for (size_t i = 0; i < row_count; i++)
        fprintf(to, "%s;%.2g;%.2g;%s;%s\n", passed(&rows[i]) ? "pass" : "FAIL", rows[i].error, rows[i].bound,
                rows[i].rule, rows[i].text);
}

static int usage(int code)
{
    printf("stress [--form tiny|brief|full] [--device D] [--only GROUP] [--csv FILE]\n"
           "Conditions that strain the arithmetic, each with its error and the bound of tests/stress/bounds.md.\n");
    return code;
}

int main(int count, char **words)
{
    static const char *const forms[] = {"tiny", "brief", "full"};
    const char *csv = NULL;
    for (int i = 1; i < count; i += 2) {
        const char *value = i + 1 < count ? words[i + 1] : NULL;
        int form = 0;
        if (!value)
            return usage(strcmp(words[i], "--help") != 0);
        if (!strcmp(words[i], "--form")) {
            while (form < 3 && strcmp(forms[form], value))
                form++;
            if (form == 3)
                return usage(1);
            stress_form_now = (stress_form)form;
        } else if (!strcmp(words[i], "--device")) {
            setenv("HADALENS_DEVICE", value, 1);
        } else if (!strcmp(words[i], "--only")) {
            cmocka_set_test_filter(value);
        } else if (!strcmp(words[i], "--csv")) {
            csv = value;
        } else {
            return usage(1);
        }
    }
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stress_transforms),   cmocka_unit_test(stress_sizes),   cmocka_unit_test(stress_frames),
        cmocka_unit_test(stress_broken),       cmocka_unit_test(stress_filters), cmocka_unit_test(stress_fit),
        cmocka_unit_test(stress_sums),         cmocka_unit_test(stress_focus),   cmocka_unit_test(stress_refinement),
        cmocka_unit_test(stress_convolutions),
    };
    const int failed = cmocka_run_group_tests(tests, NULL, NULL);
    print_table();
    FILE *file = csv ? fopen(csv, "w") : NULL;
    if (csv && !file)
        return usage(1);
    if (file) {
        print_csv(file);
        fclose(file);
    }
    return failed != 0;
}
