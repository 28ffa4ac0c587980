#include <math.h>
#include <stdlib.h>

#include "core/base.h"
#include "refine/proximal.h"
#include "surface/level.h"

static const char what[] = "a surface";

/* From the nearest depth to the farthest light at the PSFs' edge moves by about so many pixels of the coarsest level:
 * then planes are told apart, and few steps from nothing find them. */
#define COARSEST_SPAN 2.6
/* Planes are told apart well where it moves by so many from a depth of the camera to the next. */
#define PLANES_APART 0.45
/* Pixels of the coarsest window, at least. */
enum { SMALLEST_WINDOW = 24 };
/* Light at the edge moves from a plane to the next by at most so many pixels of a level. */
#define PLANE_STEP 0.6
enum {
    MARGIN = 2,     /* pixels by which a coarse window is wider on every side, for the blur of its edge */
    CROP_MARGIN = 2 /* and a coarse frame smaller: low-passing mixes in what lies outside the sensor */
};

/* A rectangle of the camera's grid on a coarser one; a pixel of it at least. */
static hada_rectangle narrow(const hada_rectangle *rect, const hada_surface_camera *camera, int rows, int cols,
                             int outward, int margin)
{
    hada_rectangle out = hada_rect_shrink(rect, camera->rows, camera->cols, rows, cols, outward, margin);
    out.rows = hada_most(out.rows, 1);
    out.cols = hada_most(out.cols, 1);
    return out;
}

static hada_surface_plan plan_of(const hada_context *context, const hada_surface_camera *camera,
                                 const hada_surface_shape *shape, const hada_magnification *magnification, int shrink,
                                 int texture)
{
    const int whole = shrink == 1, rows = hada_rect_grid_size(camera->rows, shrink);
    const int cols = hada_rect_grid_size(camera->cols, shrink);
    hada_surface_plan plan = {.shrink = shrink,
                              .steps = hada_magnification_steps(magnification, PLANE_STEP * shrink),
                              .before = hada_magnification_beyond(magnification, 0) > 0.0,
                              .whole = whole,
                              .layout = hada_surface_layout(context, rows, cols)};
    /* what stands beyond the camera's depths is not to be taken for the nearest of them */
    const int behind = (int)(hada_magnification_beyond(magnification, 1) * plan.steps);
    plan.shape = (hada_volume_shape){.rows = rows,
                                     .cols = cols,
                                     .frame = shape->frame,
                                     .window = shape->window,
                                     .boundary = shape->boundary,
                                     .channels = camera->channels,
                                     .planes = (plan.before + camera->depths - 1) * plan.steps + 1 + behind,
                                     .free = !texture,
                                     .weighs = whole && shape->weighs};
    if (!whole) {
        plan.shape.frame = narrow(&shape->frame, camera, rows, cols, 0, CROP_MARGIN);
        plan.shape.window = narrow(&shape->window, camera, rows, cols, 1, MARGIN);
    }
    return plan;
}

int hada_surface_levels(const hada_context *context, const hada_surface_camera *camera, const hada_surface_shape *shape,
                        const hada_magnification *magnification, hada_surface_plan *plans)
{
    const int side = shape->window.rows < shape->window.cols ? shape->window.rows : shape->window.cols;
    double span = 0.0;
    int shrink = 1, count = 0;
    for (int k = 0; k + 1 < camera->depths; k++)
        span += hada_magnification_shift(magnification, k, magnification->edge);
    /* powers of two: the nearest by the logarithm */
    while (count < HADA_SURFACE_LEVELS - 2 && span / shrink > COARSEST_SPAN * sqrt(2.0) &&
           side / (2 * shrink) >= SMALLEST_WINDOW) {
        shrink *= 2;
        count++;
    }
    count = 0;
    do
        plans[count++] = plan_of(context, camera, shape, magnification, shrink, 0);
    while (shrink > 1 && (shrink /= 2) && (shrink > 1 || magnification->shift < PLANES_APART));
    plans[count++] = plan_of(context, camera, shape, magnification, 1, 1);
    return count;
}

static size_t pixel_bytes(const hada_surface_plan *plan)
{
    return (size_t)plan->shape.channels * (size_t)plan->shape.frame.rows * (size_t)plan->shape.frame.cols *
           sizeof(float);
}

static hada_status level_make(hada_surface_level *level, hada_slot *slot, const hada_surface_plan *plan,
                              hada_between *between, hada_buffer *plane, hada_error *err)
{
    const hada_fft_desc inverse =
        hada_fft_of(HADA_FFT_INVERSE, plan->shape.rows, plan->shape.cols, plan->shape.channels, plan->shape.frame);
    *level = (hada_surface_level){.plan = *plan};
    HADA_TRY(hada_volume_create(&level->volume, slot, &plan->shape, err));
    for (int k = 0; k < plan->shape.planes; k++) {
        const double depth = (double)k / plan->steps - plan->before;
        HADA_TRY(hada_between_make(between, 1, &depth, plane->mem, 0, plan->whole ? NULL : &plan->layout, err));
        HADA_TRY(hada_volume_set_camera(level->volume, k, plane->mem, 0, err));
    }
    if (plan->whole)
        return HADA_OK;
    HADA_TRY(hada_buffer_create(&level->spectrum, slot->context,
                                hada_spectra_bytes(&plan->layout, plan->shape.channels), what, err));
    if (plan->shape.boundary != HADA_BOUNDARY_PADDED)
        return HADA_OK;
    HADA_TRY(hada_buffer_create(&level->pixels, slot->context, pixel_bytes(plan), what, err));
    HADA_TRY(hada_fft_create(&level->inverse, slot, &inverse, err));
    return HADA_OK;
}

static void level_free(hada_surface_level *level)
{
    hada_volume_destroy(&level->volume);
    hada_fft_destroy(&level->inverse);
    HADA_DESTROY_BUFFERS(&level->spectrum, &level->pixels);
}

hada_status hada_surface_level_load(hada_surface_level *level, hada_slot *slot, const hada_spectrum_layout *from,
                                    const hada_surface_frame *frame, hada_error *err)
{
    const hada_surface_plan *plan = &level->plan;
    const hada_spectrum_layout *to = &plan->layout;
    /* image values stay as they are */
    const double ratio = (double)to->rows * to->cols / ((double)from->rows * from->cols);
    if (plan->whole) {
        hada_volume_set_frame(level->volume, frame->spectrum, frame->spectrum_offset, frame->pixels,
                              frame->pixels_offset, frame->weights);
        return HADA_OK;
    }
    HADA_TRY(hada_surface_crop(slot, frame->spectrum, frame->spectrum_offset, from, plan->shape.channels, 1, ratio, 0.0,
                               level->spectrum.mem, 0, to, err));
    if (level->inverse)
        HADA_TRY(hada_fft_inverse(level->inverse, plan->shape.channels, level->spectrum.mem, 0, level->pixels.mem, 0,
                                  NULL, err));
    hada_volume_set_frame(level->volume, level->spectrum.mem, 0, level->pixels.mem, 0, NULL);
    return HADA_OK;
}

hada_map_place hada_surface_level_place(const hada_surface_plan *of, const hada_surface_plan *in)
{
    const double down = (double)in->shape.rows / of->shape.rows, along = (double)in->shape.cols / of->shape.cols;
    return (hada_map_place){of->shape.window.row0 * down - in->shape.window.row0,
                            of->shape.window.col0 * along - in->shape.window.col0, down, along};
}

/* What a surface is made of, and how much of it: known before a frame comes. */

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

static hada_status make_arrays(hada_surface *s, const sizes *n, hada_error *err)
{
    hada_context *context = s->slot->context;
    HADA_TRY(hada_buffer_create(&s->map, context, n->area * sizeof(float), what, err));
    HADA_TRY(hada_buffer_create(&s->texture, context, texture_bytes(n), what, err));
    HADA_TRY(hada_buffer_create(&s->allowed, context, n->values * sizeof(float), what, err));
    for (int i = 0; i < 2; i++) {
        HADA_TRY(HADA_NEW(s->planes[i], n->values, what, err));
        HADA_TRY(HADA_NEW(s->depth[i], n->area, what, err));
        HADA_TRY(HADA_NEW(s->image[i], n->area * (size_t)s->camera.channels, what, err));
    }
    HADA_TRY(HADA_NEW(s->outside, n->area, what, err));
    HADA_TRY(HADA_NEW(s->mask, n->values, what, err));
    HADA_TRY(HADA_NEW(s->sum, n->area, what, err));
    HADA_TRY(HADA_NEW(s->confidence, n->area, what, err));
    HADA_TRY(HADA_NEW(s->light, (size_t)s->camera.channels, what, err));
    HADA_TRY(HADA_NEW(s->shift, (size_t)s->camera.depths, what, err));
    return HADA_NEW(s->power, s->layout.count, what, err);
}

static hada_status make_levels(hada_surface *s, const hada_surface_plan *plans, const hada_magnification *magnification,
                               hada_error *err)
{
    hada_between *between = NULL;
    hada_buffer plane = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_between_create(&between, s->slot, &s->camera, magnification, err));
    HADA_TRY_OR_DONE(
        hada_buffer_create(&plane, s->slot->context, hada_spectra_bytes(&s->layout, s->camera.channels), what, err));
    for (int l = 0; l < s->levels; l++)
        HADA_TRY_OR_DONE(level_make(&s->level[l], s->slot, &plans[l], between, &plane, err));
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
    HADA_TRY_OR_DONE(HADA_NEW_RAW(values, 2 * count, what, err));
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
    HADA_TRY_OR_DONE(HADA_NEW(s, 1, what, err));
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
    hada_surface *s = hada_taken(pointer);
    if (!s)
        return;
    hada_slot_finish(s->slot, NULL);
    for (int l = 0; l < s->levels; l++)
        level_free(&s->level[l]);
    HADA_DESTROY_BUFFERS(&s->map, &s->texture, &s->allowed);
    HADA_FREE(s->planes[0], s->planes[1], s->mask, s->depth[0], s->depth[1], s->sum, s->image[0], s->image[1],
              s->confidence, s->power, s->outside, s->light, s->shift, s);
}
