/* What a surface is made of, and how much of it: known before a frame comes. */
#include <stdlib.h>

#include "core/alloc.h"
#include "refine/variation.h"
#include "surface/surface_state.h"

static const char what[] = "a surface";

/* Values of the planes and of the largest window, of all levels at most; of the texture. */
typedef struct sizes {
    size_t values, area, texture;
} sizes;

static sizes sizes_of(const hada_surface_plan *plans, int levels)
{
    const hada_surface_plan *last = &plans[levels - 1];
    sizes n = {.texture = (size_t)last->shape.channels * hada_surface_area(last)};
    for (int l = 0; l < levels; l++) {
        n.area = hada_surface_area(&plans[l]) > n.area ? hada_surface_area(&plans[l]) : n.area;
        if (l + 1 < levels && hada_surface_values(&plans[l]) > n.values)
            n.values = hada_surface_values(&plans[l]);
    }
    return n;
}

static size_t texture_bytes(const sizes *n)
{
    return (n->texture + HADA_VARIATION_ROOM) * sizeof(float);
}

static size_t plane_bytes(const hada_surface_camera *camera, const hada_spectrum_layout *layout)
{
    return (size_t)camera->channels * layout->count * 2 * sizeof(float);
}

static hada_status make_arrays(hada_surface *s, const sizes *n, hada_error *err)
{
    hada_context *context = s->slot->context;
    HADA_TRY(hada_buffer_create(&s->map, context, n->area * sizeof(float), what, err));
    HADA_TRY(hada_buffer_create(&s->texture, context, texture_bytes(n), what, err));
    HADA_TRY(hada_buffer_create(&s->allowed, context, n->values * sizeof(float), what, err));
    for (int i = 0; i < 2; i++) {
        HADA_TRY(hada_allocated(s->planes[i] = hada_alloc(n->values, sizeof(float), what, err)));
        HADA_TRY(hada_allocated(s->depth[i] = hada_alloc(n->area, sizeof(float), what, err)));
        HADA_TRY(
            hada_allocated(s->image[i] = hada_alloc(n->area * (size_t)s->camera.channels, sizeof(float), what, err)));
    }
    HADA_TRY(hada_allocated(s->outside = hada_alloc(n->area, 1, what, err)));
    HADA_TRY(hada_allocated(s->mask = hada_alloc(n->values, sizeof(float), what, err)));
    HADA_TRY(hada_allocated(s->sum = hada_alloc(n->area, sizeof(float), what, err)));
    HADA_TRY(hada_allocated(s->confidence = hada_alloc(n->area, sizeof(float), what, err)));
    HADA_TRY(hada_allocated(s->light = hada_alloc((size_t)s->camera.channels, sizeof *s->light, what, err)));
    HADA_TRY(hada_allocated(s->shift = hada_alloc((size_t)s->camera.depths, sizeof *s->shift, what, err)));
    return hada_allocated(s->power = hada_alloc(s->layout.count, sizeof *s->power, what, err));
}

static hada_status make_levels(hada_surface *s, const hada_surface_plan *plans, const hada_magnification *magnification,
                               hada_error *err)
{
    hada_between *between = NULL;
    hada_buffer plane = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_between_create(&between, s->slot, &s->camera, magnification, err));
    HADA_TRY_OR_DONE(hada_buffer_create(&plane, s->slot->context, plane_bytes(&s->camera, &s->layout), what, err));
    for (int l = 0; l < s->levels; l++)
        HADA_TRY_OR_DONE(hada_surface_level_make(&s->level[l], s->slot, &plans[l], between, &plane, err));
done:
    hada_between_destroy(&between);
    hada_buffer_destroy(&plane);
    return status;
}

/* What is known of the camera without a frame. */
static hada_status measure(hada_surface *s, const hada_magnification *magnification, hada_error *err)
{
    const int channels = s->camera.channels, depths = s->camera.depths;
    const size_t count = s->layout.count, from = s->camera.first + (size_t)(depths / 2 * channels);
    const hada_buffer otf =
        hada_surface_view(s, s->camera.otf, (s->camera.first + (size_t)(depths * channels)) * count * 2);
    float *values = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(values = hada_alloc_raw(2 * count, sizeof *values, what, err)));
    for (size_t c = 0; c < (size_t)channels; c++) {
        HADA_TRY_OR_DONE(hada_buffer_read(&otf, s->slot, (from + c) * count * 2 * sizeof *values, values,
                                          count * 2 * sizeof *values, err));
        s->light[c] = values[0];
        for (size_t i = 0; i < count; i++)
            s->power[i] += (values[2 * i] * values[2 * i] + values[2 * i + 1] * values[2 * i + 1]) / (float)channels;
    }
    for (int k = 0; k < depths; k++)
        s->shift[k] = depths < 2 ? 0.0
                                 : hada_magnification_shift(magnification, k < depths - 1 ? k : depths - 2,
                                                            magnification->spread);
done:
    free(values);
    return status;
}

hada_status hada_surface_create(hada_surface **out, hada_slot *slot, const hada_surface_camera *camera,
                                const hada_surface_shape *shape, const hada_magnification *magnification,
                                hada_error *err)
{
    hada_surface_plan plans[HADA_SURFACE_LEVELS];
    hada_surface *s = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_allocated(s = hada_alloc(1, sizeof *s, what, err)));
    s->slot = slot;
    s->camera = *camera;
    s->layout = hada_surface_layout(slot->context, camera->rows, camera->cols);
    s->levels = hada_surface_levels(slot->context, camera, shape, magnification, plans);
    const sizes n = sizes_of(plans, s->levels);
    HADA_TRY_OR_DONE(make_arrays(s, &n, err));
    HADA_TRY_OR_DONE(make_levels(s, plans, magnification, err));
    if (!slot->context->dry)
        HADA_TRY_OR_DONE(measure(s, magnification, err));
    *out = s;
done:
    if (status)
        hada_surface_destroy(&s);
    return status;
}

void hada_surface_destroy(hada_surface **pointer)
{
    if (!pointer || !*pointer)
        return;
    hada_surface *s = *pointer;
    *pointer = NULL;
    hada_slot_finish(s->slot, NULL);
    for (int l = 0; l < s->levels; l++)
        hada_surface_level_free(&s->level[l]);
    hada_buffer_destroy(&s->map);
    hada_buffer_destroy(&s->texture);
    hada_buffer_destroy(&s->allowed);
    float *floats[] = {s->planes[0], s->planes[1], s->mask,     s->depth[0],   s->depth[1],
                       s->sum,       s->image[0],  s->image[1], s->confidence, s->power};
    for (size_t i = 0; i < HADA_COUNT(floats); i++)
        free(floats[i]);
    free(s->outside);
    free(s->light);
    free(s->shift);
    free(s);
}
