/* The check tool: see check.h and README.md.
 *   check [--op NAME] [--shape TEXT] [--mode MODE] [--device D] [--seed N] [--largest N] [--shapes FOLDER]
 *         [--cover FOLDER] [--csv] [--list-kernels]       MODE: correct, bits, both, time, compile or cover */
#include "check.h"

#include <ctype.h>

#include "core/clock.h"
#include "runtime/launch.h"
#include "runtime/tuning.h"

enum { GUARD = 256 };
static const float guard_value = -12345.0f;

typedef struct settings {
    const char *op, *shape, *mode, *device, *folder, *cover;
    uint64_t seed;
    int csv, list, largest; /* largest: 0 all, else shapes with a larger number are left out */
} settings;

typedef enum verdict { PASSED, FAILED, SKIPPED } verdict;

int check_get(const check_state *state, char letter, int otherwise)
{
    for (const char *p = state->shape; *p; p++)
        if (*p == letter && (isdigit((unsigned char)p[1]) || p[1] == '-'))
            return atoi(p + 1);
    return otherwise;
}

hada_status check_output(check_state *state, size_t count, hada_error *err)
{
    state->out_offset = GUARD;
    state->out_count = count;
    state->expected = calloc(count ? count : 1, sizeof(double));
    if (!state->expected)
        return hada_fail(err, HADA_ERROR_MEMORY, "no memory for the expected values");
    return hada_buffer_create(&state->out, state->slot->context, (count + 2 * GUARD) * sizeof(float), "the output",
                              err);
}

void check_fill_integers(const check_state *state, uint64_t stream, float *out, size_t count, int largest)
{
    hada_random random;
    hada_random_seed(&random, state->seed, stream);
    for (size_t i = 0; i < count; i++)
        out[i] = (float)((int)hada_random_below(&random, 2u * (unsigned)largest + 1) - largest);
}

void check_fill_normal(const check_state *state, uint64_t stream, float *out, size_t count)
{
    hada_random random;
    hada_random_seed(&random, state->seed, stream);
    for (size_t i = 0; i < count; i++)
        out[i] = (float)hada_random_normal(&random);
}

float *check_normal(check_state *state, size_t count, double **exact)
{
    float *values = check_room(state, count * sizeof *values);
    *exact = check_room(state, count * sizeof **exact);
    check_fill_normal(state, 0, values, count);
    for (size_t i = 0; i < count; i++)
        (*exact)[i] = values[i];
    return values;
}

hada_status check_region(check_state *state, size_t first, size_t count, cl_mem *region, hada_error *err)
{
    const cl_buffer_region part = {(state->out_offset + first) * sizeof(float), count * sizeof(float)};
    cl_int code = CL_OUT_OF_RESOURCES;
    if (state->regions < CHECK_REGIONS)
        *region = clCreateSubBuffer(state->out.mem, CL_MEM_READ_WRITE, CL_BUFFER_CREATE_TYPE_REGION, &part, &code);
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clCreateSubBuffer");
    state->region[state->regions++] = *region;
    return HADA_OK;
}

int check_both_shapes(const hada_context *context)
{
    const char *forced = getenv("HADALENS_SHAPE");
    return context->info.kind == HADA_DEVICE_CPU && !(forced && *forced);
}

size_t check_local(const check_state *state, size_t groups)
{
    return state->slot->context->shape == HADA_SHAPE_GROUPS ? groups : 1;
}

hada_status check_clear(check_state *state, size_t first, size_t count, hada_error *err)
{
    return hada_buffer_clear(&state->out, state->slot, (state->out_offset + first) * sizeof(float),
                             count * sizeof(float), err);
}

void *check_room(check_state *state, size_t bytes)
{
    void *room = state->rooms < CHECK_ROOMS ? calloc(bytes ? bytes : 1, 1) : NULL;
    if (!room) {
        fprintf(stderr, "check: no room for %zu bytes\n", bytes);
        exit(1);
    }
    return state->room[state->rooms++] = room;
}

void *check_own(check_state *state, size_t bytes)
{
    return state->own = check_room(state, bytes);
}

static void keep(check_state *state, hada_buffer *buffer)
{
    if (state->buffers == CHECK_BUFFERS) {
        fprintf(stderr, "check: more than %d buffers\n", CHECK_BUFFERS);
        exit(1);
    }
    state->buffer[state->buffers++] = buffer;
}

hada_status check_scratch(check_state *state, hada_buffer *buffer, size_t bytes, hada_error *err)
{
    keep(state, buffer);
    return hada_buffer_create(buffer, state->slot->context, bytes, "the check", err);
}

hada_status check_upload(check_state *state, hada_buffer *buffer, const void *data, size_t bytes, hada_error *err)
{
    keep(state, buffer);
    return hada_buffer_create_from(buffer, state->slot, data, bytes, "an input", err);
}

static hada_status fill_guards(check_state *state, hada_error *err)
{
    size_t count = state->out_count + 2 * GUARD;
    cl_int code = clEnqueueFillBuffer(state->slot->queue, state->out.mem, &guard_value, sizeof guard_value, 0,
                                      count * sizeof(float), 0, NULL, NULL);
    return code == CL_SUCCESS ? HADA_OK : hada_fail_cl(err, code, "clEnqueueFillBuffer");
}

/* Runs the operation once on a fresh output and reads everything back, guard zones included. */
static hada_status run_once(check_state *state, float *all, hada_error *err)
{
    HADA_TRY(fill_guards(state, err));
    HADA_TRY(state->op->launch(state, err));
    return hada_buffer_read(&state->out, state->slot, 0, all, (state->out_count + 2 * GUARD) * sizeof(float), err);
}

static verdict compare(const check_state *state, const float *all, char *note, size_t size)
{
    double difference = 0, norm = 0, largest = 0;
    const float *out = all + GUARD;
    for (size_t i = 0; i < GUARD; i++)
        if (all[i] != guard_value || out[state->out_count + i] != guard_value) {
            snprintf(note, size, "wrote outside its output (%zu %s)", i, all[i] != guard_value ? "before" : "after");
            return FAILED;
        }
    for (size_t i = 0; i < state->out_count; i++) {
        if (!isfinite(out[i])) {
            snprintf(note, size, "value %zu is not finite", i);
            return FAILED;
        }
        if (state->unspecified && state->unspecified[i]) {
            if (state->unspecified[i] != CHECK_UNTOUCHED || out[i] == guard_value)
                continue;
            snprintf(note, size, "wrote value %zu, which is none of its own", i);
            return FAILED;
        }
        double d = out[i] - state->expected[i];
        difference += d * d;
        norm += state->expected[i] * state->expected[i];
        if (fabs(d) > largest)
            largest = fabs(d);
    }
    double relative = norm > 0 ? sqrt(difference / norm) : sqrt(difference);
    snprintf(note, size, "relative error %.2e (allowed %.1e), largest %.2e", relative, state->tolerance, largest);
    /* a reference of zeros proves nothing */
    if (norm == 0 && state->out_count > 4) {
        snprintf(note, size, "the expected output is all zero: not to be trusted");
        return FAILED;
    }
    return relative <= state->tolerance ? PASSED : FAILED;
}

static verdict check_correct(check_state *state, float *all, char *note, size_t size, hada_error *err)
{
    if (run_once(state, all, err)) {
        snprintf(note, size, "%s", err->message);
        return FAILED;
    }
    return compare(state, all, note, size);
}

/* Twice the same, then in pieces of one: the same bits each time. */
static verdict check_bits(check_state *state, float *all, char *note, size_t size, hada_error *err)
{
    size_t bytes = (state->out_count + 2 * GUARD) * sizeof(float);
    float *again = malloc(bytes);
    static const int limits[] = {0, 0, 1, 2, 3};
    verdict result = again ? PASSED : FAILED;
    snprintf(note, size, "same bits in two runs and in batches of 1, 2, 3");
    for (size_t i = 0; result == PASSED && i < HADA_COUNT(limits); i++) {
        state->batch_limit = limits[i];
        if (run_once(state, i ? again : all, err)) {
            snprintf(note, size, "%s", err->message);
            result = FAILED;
        } else if (i && memcmp(all, again, bytes)) {
            snprintf(note, size, limits[i] ? "other bits in batches of %d" : "other bits in a second run", limits[i]);
            result = FAILED;
        }
    }
    state->batch_limit = 0;
    free(again);
    return result;
}

static int by_value(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static verdict check_time(check_state *state, char *note, size_t size, const settings *how, hada_error *err)
{
    enum { RUNS = 200 };
    double times[RUNS], start = hada_seconds();
    int n = 0;
    hada_status status = state->op->launch(state, err);
    if (!status)
        status = hada_slot_finish(state->slot, err);
    while (!status && n < RUNS && (n < 5 || hada_seconds() - start < 1.0)) {
        double t = hada_seconds();
        status = state->op->launch(state, err);
        if (!status)
            status = hada_slot_finish(state->slot, err);
        times[n++] = hada_seconds() - t;
    }
    if (status) {
        snprintf(note, size, "%s", err->message);
        return FAILED;
    }
    qsort(times, (size_t)n, sizeof *times, by_value);
    double median = times[n / 2];
    if (how->csv)
        snprintf(note, size, "%.6g,%.6g,%.4g,%.4g,%d", median * 1e3, times[0] * 1e3, state->bytes / median * 1e-9,
                 state->flops / median * 1e-9, n);
    else
        snprintf(note, size, "median %.3f ms, fastest %.3f ms, %.1f GB/s, %.1f GFLOP/s", median * 1e3, times[0] * 1e3,
                 state->bytes / median * 1e-9, state->flops / median * 1e-9);
    return PASSED;
}

static verdict run_case(hada_slot *slot, const check_op *op, const char *shape, const settings *how)
{
    check_state state = {.op = op, .shape = shape, .seed = how->seed, .slot = slot};
    state.timing = !strcmp(how->mode, "time");
    const hada_kernel_shape own_shape = slot->context->shape;
    const uint64_t own_local = slot->context->info.local_memory_bytes;
    const unsigned own_units = slot->context->info.compute_units, own_floats = slot->context->vector_floats;
    /* which kernels are used depends on the number of units: the same ones are checked on every machine */
    if (!state.timing)
        slot->context->info.compute_units = 2;
    slot->context->vector_floats = (unsigned)check_get(&state, 'v', state.timing ? (int)own_floats : 8);
    slot->context->shape =
        check_get(&state, 'g', own_shape == HADA_SHAPE_GROUPS) ? HADA_SHAPE_GROUPS : HADA_SHAPE_LANES;
    if (check_get(&state, 't', 0))
        slot->context->info.local_memory_bytes = 8;
    hada_error error = {0};
    char tuning_path[1024];
    hada_tuning *tuning = NULL, *const own_tuning = slot->context->tuning;
    snprintf(tuning_path, sizeof tuning_path, "%s/rows.tuning", how->folder);
    char note[2 * sizeof error.message] = "";
    verdict result = FAILED;
    float *all = NULL;
    if (check_get(&state, 'u', 0) && hada_tuning_read(&tuning, tuning_path, &error)) {
        fprintf(stderr, "%s\n", error.message);
        exit(1);
    }
    if (tuning)
        slot->context->tuning = tuning;
    hada_status status = op->prepare(&state, &error);
    if (!status)
        all = malloc((state.out_count + 2 * GUARD) * sizeof(float));
    if (status == HADA_ERROR_UNSUPPORTED || status == HADA_ERROR_DEVICE_MEMORY)
        result = SKIPPED;
    if (status || !all)
        snprintf(note, sizeof note, "%s", status ? error.message : "no memory");
    else if (!strcmp(how->mode, "bits"))
        result = check_bits(&state, all, note, sizeof note, &error);
    else if (!strcmp(how->mode, "time"))
        result = check_time(&state, note, sizeof note, how, &error);
    else
        result = check_correct(&state, all, note, sizeof note, &error);
    if (result == PASSED && !strcmp(how->mode, "both")) {
        char bits[sizeof note];
        result = check_bits(&state, all, bits, sizeof bits, &error);
        if (result == FAILED)
            snprintf(note, sizeof note, "%s", bits);
    }
    clFinish(slot->queue);
    if (op->release && state.own)
        op->release(&state);
    for (int i = 0; i < state.regions; i++) {
        hada_arguments_forget(slot->context, state.region[i]);
        clReleaseMemObject(state.region[i]);
    }
    for (int i = 0; i < state.buffers; i++)
        hada_buffer_destroy(state.buffer[i]);
    for (int i = 0; i < state.rooms; i++)
        free(state.room[i]);
    slot->context->shape = own_shape;
    slot->context->info.local_memory_bytes = own_local;
    slot->context->tuning = own_tuning;
    hada_tuning_destroy(&tuning);
    slot->context->info.compute_units = own_units;
    slot->context->vector_floats = own_floats;
    hada_buffer_destroy(&state.out);
    HADA_FREE(state.expected, all);
    if (how->csv && result == PASSED)
        printf("%s,%s,%s\n", op->name, shape, note);
    else
        printf("%-7s %-16s %-28s %s\n",
               result == PASSED    ? "ok"
               : result == SKIPPED ? "skipped"
                                   : "FAILED",
               op->name, shape, note);
    if (result == FAILED)
        printf("        again with: check --op %s --shape %s --mode %s --seed %llu --device %d\n", op->name, shape,
               how->mode, (unsigned long long)how->seed, slot->context->info.index);
    fflush(stdout);
    return result;
}

/* A line that asks for the kernels of the other shape, where only one is run. */
static int of_other_shape(const hada_slot *slot, const char *shape)
{
    const check_state state = {.shape = shape};
    const int own = slot->context->shape == HADA_SHAPE_GROUPS;
    return !check_both_shapes(slot->context) && check_get(&state, 'g', own) != own;
}

static int larger(const char *shape, int largest)
{
    for (const char *p = shape; largest && *p; p++)
        if (isdigit((unsigned char)*p) && atoi(p) > largest)
            return 1;
    return 0;
}

static void run_file(hada_slot *slot, const check_op *op, const settings *how, int counts[3])
{
    char path[1024], line[256];
    snprintf(path, sizeof path, "%s/%s.txt", how->folder, op->name);
    FILE *file = fopen(path, "r");
    if (!file) {
        printf("FAILED  %s: the shapes %s cannot be read\n", op->name, path);
        counts[FAILED]++;
        return;
    }
    while (fgets(line, sizeof line, file)) {
        char shape[256];
        /* shapes after a '*' are large: for timing only */
        int large = line[0] == '*';
        if (line[0] == '#' || sscanf(line + large, "%255s", shape) != 1 || (large && strcmp(how->mode, "time")) ||
            larger(shape, how->largest) || of_other_shape(slot, shape))
            continue;
        counts[run_case(slot, op, shape, how)]++;
    }
    fclose(file);
}

static int usage(const char *word)
{
    printf("check [--op NAME] [--shape TEXT] [--mode correct|bits|both|time|compile|cover] [--device D] [--seed N] "
           "[--largest N] [--shapes FOLDER] [--cover FOLDER] [--csv] [--list-kernels]\n");
    for (size_t o = 0; o < check_op_count; o++)
        printf("  %-16s %s\n", check_ops[o]->name, check_ops[o]->help);
    return strcmp(word, "--help") ? 2 : 0;
}

/* The first word that is none of the options, or NULL. */
static const char *read_words(int count, char **words, settings *how)
{
    const char *seed = "1", *largest = "0";
    const struct {
        const char *name, **value;
    } options[] = {{"--op", &how->op}, {"--shape", &how->shape}, {"--mode", &how->mode},     {"--device", &how->device},
                   {"--seed", &seed},  {"--largest", &largest},  {"--shapes", &how->folder}, {"--cover", &how->cover}};
    for (int i = 1; i < count; i++) {
        size_t k = 0;
        while (k < HADA_COUNT(options) && strcmp(words[i], options[k].name))
            k++;
        if (k < HADA_COUNT(options))
            *options[k].value = ++i < count ? words[i] : "";
        else if (!strcmp(words[i], "--csv"))
            how->csv = 1;
        else if (!strcmp(words[i], "--list-kernels"))
            how->list = 1;
        else
            return words[i];
    }
    how->seed = strtoull(seed, NULL, 10);
    how->largest = atoi(largest);
    return NULL;
}

/* What the runs of single operations left: have all kernels been launched? */
static void run_cover(const hada_slot *slot, const char *program, const settings *how, int counts[3])
{
    int partial = 0;
    if (check_cover_load(how->cover ? how->cover : ".", program, &partial))
        counts[SKIPPED] = 1;
    else if ((counts[FAILED] = check_cover_report(slot, how->list, partial)) == 0)
        counts[PASSED] = 1;
    check_cover_forget();
}

static void run_operations(hada_slot *slot, const settings *how, int counts[3])
{
    int found = 0;
    for (size_t o = 0; o < check_op_count; o++) {
        if (how->op && strcmp(how->op, check_ops[o]->name))
            continue;
        found = 1;
        if (how->shape)
            counts[run_case(slot, check_ops[o], how->shape, how)]++;
        else
            run_file(slot, check_ops[o], how, counts);
    }
    if (!found) {
        printf("FAILED  there is no operation %s\n", how->op);
        counts[FAILED]++;
    }
    const int all = !how->shape && !how->largest;
    if (found && how->cover && how->op && all)
        counts[FAILED] += check_cover_save(slot, how->cover, how->op, counts[SKIPPED] > 0);
    /* a run of everything must have launched everything, unless the device cannot */
    if (how->list || (!how->op && all && !strcmp(how->mode, "correct")))
        counts[FAILED] += check_cover_report(slot, how->list, counts[SKIPPED] > 0);
}

int main(int count, char **words)
{
    settings how = {.mode = "correct", .folder = CHECK_SHAPES, .seed = 1};
    const char *unknown = read_words(count, words, &how);
    if (unknown)
        return usage(unknown);

    hada_context *context;
    hada_slot *slot;
    hada_error error;
    DEFAULTS(hada_context_options, options);
    options.device = how.device;
    if (hada_context_create(&context, &options, &error) || hada_slot_create(&slot, context, &error)) {
        printf("FAILED  %s\n", error.message);
        return 1;
    }
    int counts[3] = {0, 0, 0};
    if (how.csv)
        printf("operation,shape,median_ms,fastest_ms,gb_per_s,gflop_per_s,runs\n");
    else
        printf("device %d: %s, kernels as %s\n", context->info.index, context->info.name,
               check_both_shapes(context) ? "lanes and groups"
                                          : hada_enum_name(HADA_ENUM_KERNEL_SHAPE, (int)context->shape));
    const int cover = !strcmp(how.mode, "cover");
    if (cover)
        run_cover(slot, words[0], &how, counts);
    else if (strcmp(how.mode, "compile"))
        run_operations(slot, &how, counts);
    else if ((counts[FAILED] = check_compile(slot)) == 0)
        counts[PASSED] = 1;
    hada_slot_destroy(&slot);
    if (hada_context_bytes(context)) {
        printf("FAILED  %llu bytes of device memory were not given back\n",
               (unsigned long long)hada_context_bytes(context));
        counts[FAILED]++;
    }
    hada_context_destroy(&context);
    if (!how.csv)
        printf("%d passed, %d failed, %d skipped\n", counts[PASSED], counts[FAILED], counts[SKIPPED]);
    if (cover && counts[SKIPPED] && !counts[FAILED])
        return 77; /* ctest: skipped */
    return counts[FAILED] || !(counts[PASSED] + counts[SKIPPED]);
}
