/* Scenes on surfaces: every pixel at its own distance. */

#include "optics/mask.h"
#include "optics/simulator.h"

/* The frame is a sum over planes in fine steps of 1/z; a pixel between two shares its light out to both in proportion.
 * From plane to plane the outermost spot moves by so many pixels (docs/explanation/simulation.md says what that
 * leaves). */
#define STEP_PIXELS 0.25
/* Opaque pixels are gathered to planes this many steps thick, each at the mean of its pixels, and hide what is farther
 * behind: one pixel of parallax at the outermost lens. Less is no jump but the slope of a surface, whose own pixels
 * would seem to hide their neighbours where rays are shared out to whole pixels. */
#define OPAQUE_STEPS 4
/* Where 1/z is 0. */
#define FAR_MM 1e9

typedef struct standing {
    hada_simulator *simulator;
    const hada_relief *surfaces;
    int count;
    double step;     /* of 1/z, per mm */
    int first, last; /* steps that hold light */
    size_t pixels;
} standing;

static double step_of(const hada_camera *camera)
{
    return STEP_PIXELS * camera->pixel_pitch_mm / (camera->aperture_mm / 2.0 * camera->distance_mm);
}

static hada_status check_surface(const standing *all, const hada_relief *surface, hada_error *err)
{
    const hada_image *image = surface->image, *map = surface->distances_mm;
    if (!image || !map)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a surface is an image and its distances");
    HADA_TRY(hada_simulator_check_image(all->simulator, image, err));
    const hada_image *first = all->surfaces[0].image;
    if (map->channels != 1 || map->rows != image->rows || map->cols != image->cols || image->rows != first->rows ||
        image->cols != first->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "distances of %d channels, %d x %d do not fit an image of %d x %d; they must have 1 channel "
                         "and its size, which all surfaces of a scene share",
                         map->channels, map->rows, map->cols, image->rows, image->cols);
    for (size_t i = 0; i < hada_image_count(map); i++)
        if (!isnan(map->data[i]) && !(map->data[i] > 0.0f && isfinite(map->data[i])))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "a distance of %g mm is not possible; use values above 0, or NaN where nothing is",
                             (double)map->data[i]);
    return HADA_OK;
}

static double steps_at(const standing *all, const hada_relief *surface, size_t pixel)
{
    return 1.0 / (double)surface->distances_mm->data[pixel] / all->step;
}

static hada_status survey(standing *all, hada_error *err)
{
    double least = INFINITY, most = -INFINITY;
    if (all->simulator->psf)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "the PSFs that the simulator was given are those of its depths alone: surfaces need a camera "
                         "whose own optics make them between the depths");
    for (int s = 0; s < all->count; s++) {
        HADA_TRY(check_surface(all, &all->surfaces[s], err));
        for (size_t i = 0; i < hada_image_count(all->surfaces[s].distances_mm); i++)
            if (!isnan(all->surfaces[s].distances_mm->data[i])) {
                least = fmin(least, steps_at(all, &all->surfaces[s], i));
                most = fmax(most, steps_at(all, &all->surfaces[s], i));
            }
    }
    if (!(least <= most && most < 1e6)) /* no pixel, or so near that the steps cannot be counted */
        HADA_TRY(
            hada_fail(err, HADA_ERROR_ARGUMENT, "a surface has no pixel at a distance that the camera could be shown"));
    all->first = (int)floor(least);
    all->last = (int)floor(most) + 1;
    all->pixels = hada_image_count(all->surfaces[0].distances_mm);
    return HADA_OK;
}

static hada_place place_of(double inverse)
{
    return (hada_place){-1, inverse > 0.0 ? 1.0 / inverse : FAR_MM};
}

/* The light that falls to the plane at step k; returns whether there is any. */
static int gather(const standing *all, int k, hada_image *light)
{
    int any = 0;
    for (size_t i = 0; i < hada_image_count(light); i++)
        light->data[i] = 0.0f;
    for (int s = 0; s < all->count; s++) {
        const hada_relief *surface = &all->surfaces[s];
        for (size_t i = 0; i < all->pixels; i++) {
            const double share =
                isnan(surface->distances_mm->data[i]) ? 0.0 : 1.0 - fabs(steps_at(all, surface, i) - k);
            if (!(share > 0.0))
                continue;
            any = 1;
            for (int c = 0; c < light->channels; c++)
                light->data[(size_t)c * all->pixels + i] +=
                    (float)share *
                    surface->image->data[(surface->image->channels == 1 ? 0 : (size_t)c) * all->pixels + i];
        }
    }
    return any;
}

static hada_status create_light(const standing *all, hada_image *light, hada_error *err)
{
    const hada_image *image = all->surfaces[0].image;
    return hada_image_create(light, all->simulator->camera.channels, image->rows, image->cols, err);
}

static hada_status add_clear(const standing *all, hada_error *err)
{
    hada_simulator *s = all->simulator;
    hada_image light = {0};
    hada_buffer scratch = {0};
    const hada_buffer *otf;
    int any = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(create_light(all, &light, err));
    for (int k = all->first; k <= all->last; k++) {
        if (!gather(all, k, &light))
            continue;
        HADA_TRY_OR_DONE(hada_simulator_otf(s, place_of(k * all->step), &scratch, &otf, err));
        HADA_TRY_OR_DONE(hada_simulator_add_image(s, &light, otf, any, err));
        any = 1;
    }
done:
    if (status)
        hada_slot_finish(s->slot, NULL);
    hada_buffer_destroy(&scratch);
    hada_image_destroy(&light);
    return status;
}

/* Opaque surfaces: layers of light, and layers that only hide. */
typedef struct stage {
    hada_layer *layers;
    hada_image *images; /* light or opacity, one a layer */
    unsigned char *reach;
    int count;
} stage;

static hada_status stage_light(const standing *all, stage *on, hada_error *err)
{
    for (int k = all->first; k <= all->last; k++) {
        hada_image *light = &on->images[on->count];
        HADA_TRY(create_light(all, light, err));
        if (gather(all, k, light))
            on->layers[on->count++] = (hada_layer){.place = place_of(k * all->step), .image = light};
        else
            hada_image_destroy(light);
    }
    return HADA_OK;
}

/* The opaque pixels from a step on, OPAQUE_STEPS thick. */
static hada_status stage_opacity(const standing *all, int from, stage *on, hada_error *err)
{
    const hada_image *first = all->surfaces[0].image;
    hada_image *opacity = &on->images[on->count];
    double sum = 0.0;
    size_t found = 0;
    HADA_TRY(hada_image_create(opacity, 1, first->rows, first->cols, err));
    for (int s = 0; s < all->count; s++)
        for (size_t i = 0; i < all->pixels; i++) {
            const double at = steps_at(all, &all->surfaces[s], i); /* NaN where nothing is */
            if (!(at >= from && at < from + OPAQUE_STEPS))
                continue;
            opacity->data[i] = 1.0f;
            sum += at;
            found++;
        }
    if (found)
        on->layers[on->count++] = (hada_layer){.place = place_of(sum / (double)found * all->step), .opacity = opacity};
    else
        hada_image_destroy(opacity);
    return HADA_OK;
}

/* sums[(r + 1) * (cols + 1) + c + 1]: opaque pixels above and left of (r, c), it included. */
static void sum_up(const hada_image *opacity, int *sums)
{
    const size_t wide = (size_t)opacity->cols + 1;
    for (size_t r = 0; r <= (size_t)opacity->rows; r++)
        for (size_t c = 0; c < wide; c++)
            sums[r * wide + c] = !r || !c
                                     ? 0
                                     : (opacity->data[(r - 1) * (wide - 1) + c - 1] > 0.0f) + sums[(r - 1) * wide + c] +
                                           sums[r * wide + c - 1] - sums[(r - 1) * wide + c - 1];
}

static int clamp(int value, int most)
{
    return value < 0 ? 0 : value > most ? most : value;
}

/* Whether there is light within a square of `radius` pixels about an opaque pixel. */
static int is_near(const hada_image *light, const int *sums, int radius)
{
    const int rows = light->rows, cols = light->cols, wide = cols + 1;
    const size_t plane = (size_t)rows * (size_t)cols;
    for (size_t i = 0; i < hada_image_count(light); i++) {
        if (!(light->data[i] > 0.0f))
            continue;
        const int r = (int)(i % plane) / cols, c = (int)(i % plane) % cols;
        const int top = clamp(r - radius, rows) * wide, bottom = clamp(r + radius + 1, rows) * wide,
                  left = clamp(c - radius, cols), right = clamp(c + radius + 1, cols);
        if (sums[bottom + right] - sums[top + right] - sums[bottom + left] + sums[top + left])
            return 1;
    }
    return 0;
}

static hada_status find_reach(const standing *all, stage *on, hada_error *err)
{
    const hada_camera *camera = &all->simulator->camera;
    const hada_image *first = all->surfaces[0].image;
    const size_t count = (size_t)on->count;
    int *sums = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(on->reach = hada_alloc(count, count, "a scene", err)));
    HADA_TRY_OR_DONE(HADA_NEW(sums, ((size_t)first->rows + 1) * ((size_t)first->cols + 1), "a scene", err));
    for (size_t j = 0; j < count; j++) {
        if (!on->layers[j].opacity)
            continue;
        sum_up(on->layers[j].opacity, sums);
        for (size_t i = 0; i < count; i++) {
            double cols, rows;
            if (!on->layers[i].image || !(on->layers[j].place.distance_mm < on->layers[i].place.distance_mm))
                continue;
            hada_camera_parallax(camera, on->layers[j].place.distance_mm, on->layers[i].place.distance_mm,
                                 (camera->aperture_mm + camera->lens_diameter_mm) / 2.0, 0.0, &cols, &rows);
            const int radius = (int)fmin(cols, 1e6) + 2; /* and the pixels that a ray is shared out to */
            on->reach[i * count + j] = (unsigned char)is_near(on->layers[i].image, sums, radius);
        }
    }
done:
    free(sums);
    return status;
}

static hada_status add_opaque(const standing *all, hada_error *err)
{
    const size_t steps = (size_t)(all->last - all->first + 1), room = steps + steps / OPAQUE_STEPS + 1;
    stage on = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(on.layers, room, "a scene", err));
    HADA_TRY_OR_DONE(HADA_NEW(on.images, room, "a scene", err));
    HADA_TRY_OR_DONE(stage_light(all, &on, err));
    for (int k = all->first; k <= all->last; k += OPAQUE_STEPS)
        HADA_TRY_OR_DONE(stage_opacity(all, k, &on, err));
    HADA_TRY_OR_DONE(find_reach(all, &on, err));
    HADA_TRY_OR_DONE(
        hada_simulator_add_layers(all->simulator, on.layers, on.count, -1, OPAQUE_STEPS * all->step, on.reach, err));
done:
    for (int i = 0; on.images && i < on.count; i++)
        hada_image_destroy(&on.images[i]);
    HADA_FREE(on.images, on.layers, on.reach);
    return status;
}

hada_status hada_simulator_render_reliefs(hada_simulator *s, const hada_relief *surfaces, int count, int opaque,
                                          double noise, uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    HADA_NEED(s && surfaces && raw, err);
    *raw = (hada_image){0};
    HADA_TRY(hada_varying_none(s, err));
    if (count < 1 || !surfaces || !(noise >= 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d surfaces with noise %g is not possible", count,
                         noise);
    standing all = {.simulator = s, .surfaces = surfaces, .count = count, .step = step_of(&s->camera)};
    HADA_TRY(survey(&all, err));
    HADA_TRY(opaque ? add_opaque(&all, err) : add_clear(&all, err));
    return hada_simulator_finish(s, noise, noise_seed, raw, err);
}
