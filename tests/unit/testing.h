/* What all unit tests include: the standard library, the whole public interface, cmocka and readable failures. */
#ifndef HADA_TESTS_TESTING_H
#define HADA_TESTS_TESTING_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
/* cmocka needs the four above first */
#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/random.h"
#include "helpers.h"
#include "runtime/context.h"

/* Fails the test with the library's own message when a call does not succeed. */
#define ASSERT_OK(call)                                                                                                \
    do {                                                                                                               \
        hada_error assert_ok_error = {0};                                                                              \
        hada_error *err = &assert_ok_error;                                                                            \
        hada_status assert_ok_status = (call);                                                                         \
        if (assert_ok_status)                                                                                          \
            fail_msg("%s: %s: %s", #call, hada_status_name(assert_ok_status), err->message);                           \
    } while (0)

/* Fails the test unless the call ends with this status and a message that holds the words ("": any message). */
#define ASSERT_FAILS(call, status, words)                                                                              \
    do {                                                                                                               \
        hada_error assert_fails_error = {0};                                                                           \
        hada_error *err = &assert_fails_error;                                                                         \
        const hada_status assert_fails_status = (call);                                                                \
        if (assert_fails_status != (status) || !*err->message || !strstr(err->message, words))                         \
            fail_msg("%s: %s: '%s', not '%s'", #call, hada_status_name(assert_fails_status), err->message, words);     \
    } while (0)

/* A test, which belongs to the group named after its file: in test_fit.c, `unit fit` runs TEST(name) { ... }. Tests run
 * in the order of the file; *state is what the group's fixture put there. */
#define TEST(name)                                                                                                     \
    static void name(void **state);                                                                                    \
    __attribute__((constructor)) static void add_##name(void)                                                          \
    {                                                                                                                  \
        unit_add_test(__FILE__, #name, name);                                                                          \
    }                                                                                                                  \
    static void name(__attribute__((unused)) void **state)

/* What runs before the first and after the last test of the file's group, and what runs around each of them. */
#define FIXTURE(set_up, tear_down)                                                                                     \
    __attribute__((constructor)) static void fixture_of_group(void)                                                    \
    {                                                                                                                  \
        unit_set_fixture(__FILE__, set_up, tear_down);                                                                 \
    }
#define FIXTURE_OF_EACH(set_up, tear_down)                                                                             \
    __attribute__((constructor)) static void fixture_of_each(void)                                                     \
    {                                                                                                                  \
        unit_set_fixture_of_each(__FILE__, set_up, tear_down);                                                         \
    }

/* Runs some tests of the file once more with another fixture. */
#define AGAIN(set_up, tear_down, ...)                                                                                  \
    __attribute__((constructor)) static void again_##set_up(void)                                                      \
    {                                                                                                                  \
        static const CMUnitTestFunction tests[] = {__VA_ARGS__};                                                       \
        unit_run_again(__FILE__, tests, sizeof tests / sizeof *tests, set_up, tear_down);                              \
    }

static inline void destroy_images(hada_image *images, int count)
{
    for (int i = 0; i < count; i++)
        hada_image_destroy(&images[i]);
}

/* Two parts of a device or, where it cannot be divided, two contexts on the whole of it. */
static inline void open_parts(const hada_context *whole, const hada_context_options *common, hada_context *part[2])
{
    const hada_device_info *device = hada_context_device(whole);
    const int divisible = device->max_sub_devices >= 2 && device->compute_units >= 2;
    hada_context_options options = *common;
    for (int i = 0; i < 2; i++) {
        options.part = divisible ? i + 1 : 0;
        options.parts = divisible ? 2 : 0;
        ASSERT_OK(hada_context_create(&part[i], &options, err));
    }
}

/* Ends a context, which must have all its memory back. */
static inline void close_context(hada_context **context)
{
    assert_int_equal(hada_context_bytes(*context), 0);
    hada_context_destroy(context);
}

/* One run of a plan of its own. */
static inline void plan_once(hada_context *context, const hada_model *model, const hada_plan_options *options,
                             const hada_image *raw, hada_result *result)
{
    SCOPED(hada_plan) * plan;
    ASSERT_OK(hada_plan_create(&plan, context, model, options, err));
    ASSERT_OK(hada_plan_run(plan, raw, result, err));
}

/* Freed by the caller. */
static inline double *doubles(const float *values, size_t count)
{
    double *out = calloc(count + 1, sizeof *out);
    for (size_t i = 0; i < count; i++)
        out[i] = values[i];
    return out;
}

/* For qsort(): ascending. */
static inline int ascending_floats(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

static inline int same_image(const hada_image *a, const hada_image *b)
{
    return a->channels == b->channels && a->rows == b->rows && a->cols == b->cols &&
           !memcmp(a->data, b->data, hada_image_count(a) * sizeof *a->data);
}

/* All images of results, to the last bit. */
static inline int same_result(const hada_result *a, const hada_result *b)
{
    int same = a->depths == b->depths && same_image(&a->all_in_focus, &b->all_in_focus) &&
               same_image(&a->distance_map, &b->distance_map);
    for (int z = 0; same && z < a->depths; z++)
        same = same_image(&a->planes[z], &b->planes[z]);
    return same;
}

/* |a - b| / |b| with b in double precision; |a - b| where b is 0. */
static inline double relative_error(const float *a, const double *b, size_t count)
{
    double error = 0.0, size = 0.0;
    for (size_t i = 0; i < count; i++) {
        error += (a[i] - b[i]) * (a[i] - b[i]);
        size += b[i] * b[i];
    }
    return size > 0.0 ? sqrt(error / size) : sqrt(error);
}

/* The same of two arrays in single precision. */
static inline double relative_change(const float *a, const float *b, size_t count)
{
    SCOPED_MEMORY double *exact = doubles(b, count);
    return relative_error(a, exact, count);
}

/* A path below a folder; a few may be in use at once. */
static inline const char *path_below(const char *folder, const char *name)
{
    static char paths[4][600];
    static int next;
    char *path = paths[next++ % 4];
    snprintf(path, sizeof paths[0], "%s/%s", folder, name);
    return path;
}

static inline void write_whole_text(const char *path, const char *text)
{
    FILE *file = fopen(path, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

void unit_add_test(const char *file, const char *name, CMUnitTestFunction test);
void unit_set_fixture(const char *file, CMFixtureFunction set_up, CMFixtureFunction tear_down);
void unit_set_fixture_of_each(const char *file, CMFixtureFunction set_up, CMFixtureFunction tear_down);
void unit_run_again(const char *file, const CMUnitTestFunction *tests, size_t count, CMFixtureFunction set_up,
                    CMFixtureFunction tear_down);

#endif
