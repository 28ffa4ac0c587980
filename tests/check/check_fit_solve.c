/* Filters and transfer functions from sums. In the output: images of filters, then images of transfer functions; each
 * image's values beyond its end are overwritten by the next image. */
#include "check_fit.h"
#include "launch/fit_solve.h"

typedef struct solve_state {
    hada_buffer sums, pool;
    check_fit fit;
    int images;
    float alpha, ridge, least;
} solve_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    solve_state *own = check_own(state, sizeof *own);
    check_fit *fit = &own->fit;
    own->images = check_get(state, 'k', 1);
    own->alpha = 0.125f * (float)check_get(state, 'a', 1);
    own->ridge = 0.25f;
    own->least = 2.0f; /* some of the scenes' sums are below it */
    const size_t n = (size_t)check_get(state, 'n', 16), all = 2 * n * (size_t)own->images;
    check_fit_make(fit, state, n, 3, check_get(state, 's', 0));
    HADA_TRY(check_output(state, 2 * all + 2 * (8 * fit->vectors - n), err));
    for (size_t k = 0; k < (size_t)own->images; k++) {
        /* an image's alpha and floor grow with its number, so that the order of images matters */
        hada_ref_fit_filter(fit->sums, fit->other, n, (double)own->alpha * (double)(k + 1), own->ridge, fit->split,
                            state->expected + 2 * n * k);
        hada_ref_fit_transfer(fit->sums, n, (double)own->least * (double)(k + 1), state->expected + all + 2 * n * k);
    }
    HADA_TRY(check_upload(state, &own->sums, fit->device_sums, 8 * (size_t)fit->kept * fit->stride, err));
    HADA_TRY(check_upload(state, &own->pool, fit->device_pool, 20 * fit->stride, err));
    state->tolerance = 1e-6; /* the sums of other depths are a difference of floats */
    state->bytes = (double)own->images * (double)n * 4.0 * (fit->split ? 13.0 : 10.0);
    return HADA_OK;
}

static hada_status launch(check_state *state, hada_error *err)
{
    solve_state *own = state->own;
    const check_fit *fit = &own->fit;
    const hada_program_fit_solve program = fit->split ? HADA_PROGRAM_FIT_SOLVE_SPLIT : HADA_PROGRAM_FIT_SOLVE_DEFAULT;
    const hada_range range = hada_range_of(fit->vectors, 64, 1, 1);
    for (int k = 0; k < 2 * own->images; k++) {
        const float factor = (float)(k % own->images + 1);
        const hada_fit_penalty penalty = {own->alpha * factor, own->ridge};
        hada_fit_image image = check_fit_image(fit, (size_t)k);
        image.first += state->out_offset / 2;
        if (k < own->images)
            HADA_TRY(hada_launch_fit_filter(state->slot, program, &range, err, .sums = own->sums.mem,
                                            .pool = own->pool.mem, .filter = state->out.mem, .image = image,
                                            .penalty = penalty));
        else
            HADA_TRY(hada_launch_fit_transfer(state->slot, program, &range, err, .sums = own->sums.mem,
                                              .otf = state->out.mem, .image = image, .least = own->least * factor));
    }
    return HADA_OK;
}

const check_op check_fit_solve = {"fit_solve", "n frequencies, k images, a eighths of alpha, s1 split", prepare, launch,
                                  NULL};
