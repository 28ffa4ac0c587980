/* The focus step: its statistics against exact medians, its means within what they are means of, its counts. */
#include "focus/focus.h"

#include "ref/ref_focus.h"
#include "stress.h"

enum { DEPTHS = 4 };
static const double distances[DEPTHS] = {100.0, 150.0, 250.0, 400.0};

typedef enum fill_kind { NOISE, RANGE, CONSTANT, BLACK, SMALL, DENORMAL, KINDS } fill_kind;
static const char *const kind_names[KINDS] = {"noise",        "pixels from 1 to 1e12", "constant planes",
                                              "black planes", "pixels up to 2^-60",    "denormal pixels up to 2^-135"};

static void fill(fill_kind kind, float *to, size_t count, int depth)
{
    const uint64_t seed = (uint64_t)depth + 1;
    if (kind == RANGE)
        stress_fill_range(to, count, seed);
    else
        stress_fill_uniform(to, count, seed);
    for (size_t i = 0; i < count; i++)
        to[i] = kind == CONSTANT ? 0.25f * (float)(depth + 1)
                : kind == BLACK  ? 0.0f
                                 : ldexpf(to[i], kind == SMALL      ? -60
                                                 : kind == DENORMAL ? -135
                                                                    : 0);
}

static double ratio(double got, double want)
{
    return want > 0.0 ? fabs(got / want - 1.0) : fabs(got);
}

static void focus(const stress_device *device, fill_kind kind, int fuse)
{
    const int small = stress_form_now == STRESS_TINY, rows = small ? 8 : 40, cols = small ? 12 : 48;
    const size_t n = (size_t)rows * (size_t)cols;
    hada_image planes[DEPTHS];
    SCOPED(hada_image) aif, map;
    hada_focus_options options;
    hada_focus_report got = {.size = sizeof got}, want;
    SCOPED_MEMORY float *stack = stress_memory(DEPTHS * n, sizeof *stack);
    SCOPED_MEMORY double *want_aif = stress_memory(n, sizeof *want_aif), *want_map = stress_memory(n, sizeof *want_map);
    SCOPED_MEMORY double *lead = stress_memory(n, sizeof *lead);
    for (int z = 0; z < DEPTHS; z++) {
        ASSERT_OK(hada_image_create(&planes[z], 1, rows, cols, err));
        fill(kind, planes[z].data, n, z);
        memcpy(stack + (size_t)z * n, planes[z].data, n * sizeof *stack);
    }
    hada_focus_options_init(&options, 0);
    options.measure = HADA_FOCUS_ENERGY; /* in the planes' own units, so that it lives as long as they do */
    options.fuse = fuse ? HADA_FOCUS_SUM : HADA_FOCUS_WEIGHTED;
    ASSERT_OK(hada_focus_stack(device->context, planes, distances, DEPTHS, NULL, &options, &aif, &map, &got, err));
    ASSERT_OK(
        hada_ref_focus(stack, 1, rows, cols, DEPTHS, distances, NULL, &options, want_aif, want_map, lead, &want, err));
    /* a mean lies between the smallest and the largest, a sum is a sum */
    size_t outside = 0;
    for (size_t i = 0; i < n; i++) {
        float low = INFINITY, high = -INFINITY, sum = 0.0f;
        for (int z = 0; z < DEPTHS; z++) {
            low = fminf(low, planes[z].data[i]);
            high = fmaxf(high, planes[z].data[i]);
            sum += planes[z].data[i];
        }
        if (fuse)
            low = high = sum;
        const float room = (float)(4.0 * DEPTHS * STRESS_U) * high + 4 * 0x1p-149f;
        outside += !(aif.data[i] >= low - room && aif.data[i] <= high + room);
    }
    stress_none("O1", outside, "all-in-focus by %s, %s: pixels outside its planes' values", fuse ? "sum" : "mean",
                kind_names[kind]);
    if (!fuse) {
        const double bin = 0x1p-8 + 1e-5; /* half a bin of 128 to the octave */
        const int tiny_values = kind == DENORMAL || kind == BLACK || kind == CONSTANT;
        /* the threshold adds a level and a spread, each the value of a bin */
        if (!tiny_values) {
            stress_row("O2", ratio(got.noise, want.noise), bin, "focus, noise level, %s", kind_names[kind]);
            stress_row("O2", ratio(got.threshold, want.threshold),
                       3.0 * bin * (1.0 + want.margin / want.threshold) + bin, "focus, threshold, %s",
                       kind_names[kind]);
        }
        if (kind == BLACK || kind == CONSTANT) {
            size_t covered = 0;
            for (size_t i = 0; i < n && kind == BLACK; i++)
                covered += !isnan(map.data[i]);
            stress_none("O1", covered, "focus, %s: pixels with a distance", kind_names[kind]);
        }
    }
    destroy_images(planes, DEPTHS);
}

/* Counts beyond 32 bits: 2^33 times every count has the same medians. */
static void large_counts(void)
{
    SCOPED_MEMORY int64_t *few = stress_memory(HADA_FOCUS_BINS, sizeof *few),
                          *many = stress_memory(HADA_FOCUS_BINS, sizeof *many);
    hada_random random;
    double median[2], spread[2];
    int64_t total;
    hada_random_seed(&random, 1, 1);
    for (int i = 0; i < HADA_FOCUS_BINS; i += 7) {
        few[i] = hada_random_below(&random, 1000);
        many[i] = few[i] << 33;
    }
    hada_focus_bins_spread(few, &median[0], &spread[0]);
    hada_focus_bins_spread(many, &median[1], &spread[1]);
    const double a = hada_focus_bins_median_positive(few, &total), b = hada_focus_bins_median_positive(many, &total);
    stress_row("O3", fabs(median[0] - median[1]) + fabs(spread[0] - spread[1]) + fabs(a - b), 0.0,
               "focus, medians of 1e16 counts against those of 2e6");
}

/* The spread of losing pixels when one plane comes `depths` times: it does not depend on how often, were it not for the
 * device's counts, which are of 31 bits. */
static double spread_of(const stress_device *device, int side, int depths, const hada_buffer *plane)
{
    hada_focus *object;
    hada_focus_report report = {.size = sizeof report};
    hada_buffer results;
    SCOPED_MEMORY double *steps = stress_memory((size_t)depths, sizeof *steps);
    hada_focus_desc desc = {.channels = 1, .rows = side, .cols = side, .depths = depths, .distances_mm = steps};
    const size_t n = (size_t)side * (size_t)side;
    for (int z = 0; z < depths; z++)
        steps[z] = 100.0 + z;
    hada_focus_options_init(&desc.options, 0);
    desc.options.measure = HADA_FOCUS_ENERGY;
    ASSERT_OK(hada_focus_create(&object, device->slot, &desc, err));
    ASSERT_OK(hada_buffer_create(&results, device->context, 2 * n * sizeof(float), "the pictures", err));
    ASSERT_OK(hada_focus_begin(object, NULL, err));
    for (int z = 0; z < depths; z++)
        ASSERT_OK(hada_focus_push(object, z, 1, plane->mem, 0, err));
    ASSERT_OK(hada_focus_finish(object, 0.0, results.mem, 0, results.mem, n, &report, err));
    hada_focus_destroy(&object);
    hada_buffer_destroy(&results);
    return report.margin / hada_focus_normal_quantile(desc.options.false_alarm / depths);
}

static void large_stack(const stress_device *device, int side, int depths)
{
    const size_t n = (size_t)side * (size_t)side;
    SCOPED(hada_buffer) plane;
    float *values = stress_memory(n, sizeof *values);
    stress_fill_uniform(values, n, 1);
    ASSERT_OK(hada_buffer_create_from(&plane, device->slot, values, n * sizeof *values, "a plane", err));
    free(values);
    const double few = spread_of(device, side, 2, &plane), many = spread_of(device, side, depths, &plane);
    stress_row("O3", fabs(many / few - 1.0), 4e-16, "focus, spread of %d planes of %d x %d against that of 2", depths,
               side, side);
}

void stress_focus(void **state)
{
    (void)state;
    stress_device device = stress_open();
    for (int k = 0; k < KINDS; k++)
        for (int fuse = 0; fuse < 2; fuse++)
            focus(&device, (fill_kind)k, fuse);
    large_counts();
    if (stress_form_now == STRESS_FULL)
        large_stack(&device, 8192, 34);
    stress_close(&device);
    stress_end_group();
}
