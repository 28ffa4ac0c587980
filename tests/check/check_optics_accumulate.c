/* The product-sum of the forward model, exact for small integers. */
#include "check.h"
#include "optics/simulator.h"

typedef struct optics_state {
    hada_buffer otf, scene;
    int images, otf_images, depths;
    size_t count;
} optics_state;

static hada_status prepare(check_state *state, hada_error *err)
{
    optics_state *own = check_own(state, sizeof *own);
    own->images = check_get(state, 'k', 3);
    own->otf_images = check_get(state, 'o', 1);
    own->count = (size_t)check_get(state, 'n', 8);
    own->depths = check_get(state, 'd', 2);
    const size_t otf = 2 * own->count * (size_t)own->otf_images, scene = 2 * own->count * (size_t)own->images;
    float *h = check_room(state, otf * sizeof *h), *x = check_room(state, scene * sizeof *x);
    HADA_TRY(check_output(state, scene, err));
    check_fill_integers(state, 1, h, otf, 9);
    check_fill_integers(state, 2, x, scene, 9);
    for (size_t i = 0; i < scene; i += 2) {
        const size_t image = i / (2 * own->count),
                     j = (image % (size_t)own->otf_images) * 2 * own->count + i % (2 * own->count);
        state->expected[i] = own->depths * ((double)h[j] * x[i] - (double)h[j + 1] * x[i + 1]);
        state->expected[i + 1] = own->depths * ((double)h[j] * x[i + 1] + (double)h[j + 1] * x[i]);
    }
    HADA_TRY(check_upload(state, &own->otf, h, otf * sizeof *h, err));
    HADA_TRY(check_upload(state, &own->scene, x, scene * sizeof *x, err));
    state->bytes = (double)own->depths * (double)(otf + 3 * scene) * sizeof(float);
    state->flops = (double)own->depths * 4.0 * (double)scene;
    return HADA_OK;
}

/* The same plane `depths` times. */
static hada_status launch(check_state *state, hada_error *err)
{
    optics_state *own = state->own;
    for (int d = 0; d < own->depths; d++)
        HADA_TRY(hada_optics_accumulate(state->slot, state->out.mem, state->out_offset / 2, own->otf.mem,
                                        own->otf_images, own->scene.mem, own->images, own->count, d > 0, err));
    return HADA_OK;
}

const check_op check_optics = {"optics_accumulate",
                               "n complex values of an image, k images, o images of the transfer function, d depths",
                               prepare, launch, NULL};
