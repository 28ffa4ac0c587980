/* Pairs of a small camera with three depths, as the tests of the fit share them. */
#ifndef HADA_TESTS_FIT_FIXTURE_H
#define HADA_TESTS_FIT_FIXTURE_H

#include "camera_small.h"
#include "fit/fitter.h"

enum { ROWS = 30, COLS = 40, WINDOW = 14, DEPTHS = 3, CHANNELS = 2, PAIRS = 4 };
static const double distances[] = {100.0, 200.0, 400.0};

typedef struct fixture {
    hada_context *context;
    char tuning[64];
    hada_image psf[DEPTHS], scene[DEPTHS][PAIRS], frame[DEPTHS][PAIRS];
} fixture;

static inline int fit_setup_with(void **state, const char *tuning)
{
    static fixture f;
    DEFAULTS(hada_context_options, options);
    if (tuning) {
        strcpy(f.tuning, "/tmp/hadalens-test-XXXXXX");
        const int file = mkstemp(f.tuning);
        assert_int_equal(write(file, tuning, strlen(tuning)), strlen(tuning));
        close(file);
        options.tuning = f.tuning;
    }
    ASSERT_OK(hada_context_create(&f.context, &options, err));
    for (int z = 0; z < DEPTHS; z++) {
        f.psf[z] = small_psf(CHANNELS, ROWS, COLS, 12, (uint64_t)z + 1);
        for (int i = 0; i < PAIRS; i++) {
            const uint64_t seed = (uint64_t)(100 * z + i + 1);
            f.scene[z][i] = small_scene(CHANNELS, WINDOW, WINDOW, seed);
            f.frame[z][i] = small_frame(&f.psf[z], &f.scene[z][i], 0, 0.003, seed);
        }
    }
    *state = &f;
    return 0;
}

static inline int fit_setup(void **state)
{
    return fit_setup_with(state, NULL);
}

/* clFFT has spectra in rows, whose number of values is no multiple of what kernels take at a time. */
static inline int fit_setup_rows(void **state)
{
    return fit_setup_with(state, "fft * * clfft\n");
}

/* As on a GPU: kernels by work-groups, and the layout of spectra that goes with them. */
static inline int fit_setup_groups(void **state)
{
    fit_setup(state);
    ((fixture *)*state)->context->shape = HADA_SHAPE_GROUPS;
    return 0;
}

static inline int fit_teardown(void **state)
{
    fixture *f = *state;
    destroy_images(f->psf, DEPTHS);
    destroy_images(f->scene[0], DEPTHS * PAIRS);
    destroy_images(f->frame[0], DEPTHS * PAIRS);
    close_context(&f->context);
    if (*f->tuning)
        unlink(f->tuning);
    *f->tuning = '\0';
    return 0;
}

static inline hada_fit_options usual(int depths, hada_form form)
{
    hada_fit_options options = helpers_fit(depths, CHANNELS, distances, ROWS, COLS, WINDOW);
    options.form = form;
    options.refine_steps = 0;
    return options;
}

static inline void add_all(fixture *f, hada_fitter *fitter, int depths, int first, int last)
{
    for (int z = 0; z < depths; z++)
        for (int i = first; i < last; i++)
            ASSERT_OK(hada_fitter_add_pair(fitter, z, &f->frame[z][i], &f->scene[z][i], err));
}

/* The pairs of the fixture as a data set; of each depth `pairs`. */
static inline hada_dataset *data_of(fixture *f, int pairs)
{
    const int counts[DEPTHS] = {pairs, pairs, pairs};
    static hada_image raws[DEPTHS * PAIRS], scenes[DEPTHS * PAIRS];
    hada_dataset *data;
    for (int k = 0; k < DEPTHS * pairs; k++) {
        raws[k] = f->frame[k / pairs][k % pairs];
        scenes[k] = f->scene[k / pairs][k % pairs];
    }
    ASSERT_OK(hada_dataset_from_images(&data, DEPTHS, distances, counts, raws, scenes, err));
    return data;
}

#endif
