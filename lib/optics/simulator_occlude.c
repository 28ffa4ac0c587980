/* Scenes with opaque planes, lens by lens, or patch by patch of a mask without lenses: each sees a plane through what
 * the nearer ones leave open for it. And scenes on surfaces. */
#include "core/callers.h"
#include "optics/mask.h"
#include "optics/occlusion.h"
#include "optics/simulator.h"

#define LEAST 1e-9 /* of the brightest pixel: there is no ray where there is less */

/* The light of a patch, blurred, on the screen. Patches at the edge of the lattice take what is beyond it. */
static hada_status trace(hada_patch_light *light, int patch, hada_error *err)
{
    const hada_lenses *p = light->patches;
    const double half = p->design.camera.aperture_mm / 2.0, centre[2] = {p->x[patch], p->y[patch]};
    double low[2], high[2], all;
    for (int k = 0; k < 2; k++) {
        const int i = (int)lrint((centre[k] + half) / p->side - 0.5);
        low[k] = i > 0 ? i * p->side - half : -HUGE_VAL;
        high[k] = i < p->across - 1 ? (i + 1) * p->side - half : HUGE_VAL;
    }
    hada_rays_clear(&light->rays);
    HADA_TRY(hada_rays_trace(&light->rays, low, high, &all, err));
    hada_rays_blur(&light->rays);
    return HADA_OK;
}

/* The pixels of the image where the screen holds light. */
static void box(const hada_patch_light *light, int first[2], int end[2])
{
    const hada_rays *r = &light->rays;
    first[0] = (int)fmax(0.0, r->top - r->margin);
    first[1] = (int)fmax(0.0, r->left - r->margin);
    end[0] = (int)fmin(light->rows, r->bottom - r->margin);
    end[1] = (int)fmin(light->cols, r->right - r->margin);
}

/* Of rows x cols pixels with the axis at (axis_row, axis_col). The patches must outlive it. */
static hada_status patch_light_make(hada_patch_light *light, const hada_lenses *patches, double distance_mm, int rows,
                                    int cols, double axis_row, double axis_col, hada_error *err)
{
    *light = (hada_patch_light){.patches = patches, .rows = rows, .cols = cols};
    HADA_TRY(hada_rays_make(&light->rays, &patches->design, distance_mm, rows, cols, axis_row, axis_col, err));
    HADA_TRY(HADA_NEW(light->all, (size_t)rows * (size_t)cols, "the light of patches", err));
    for (int p = 0; p < patches->count; p++) {
        int first[2], end[2];
        HADA_TRY(trace(light, p, err));
        box(light, first, end);
        for (int r = first[0]; r < end[0]; r++)
            for (int c = first[1]; c < end[1]; c++) {
                double *sum = &light->all[(size_t)r * (size_t)cols + (size_t)c];
                *sum += hada_rays_at(&light->rays, r, c);
                light->least = fmax(light->least, LEAST * *sum);
            }
    }
    return HADA_OK;
}

static void patch_light_free(hada_patch_light *light)
{
    hada_rays_free(&light->rays);
    free(light->all);
    *light = (hada_patch_light){0};
}

/* The share of a patch; labels: hada_lens_labels() of the patches on the same grid. */
static hada_status patch_light_share(hada_patch_light *light, int patch, const int *labels, float *share,
                                     hada_error *err)
{
    int first[2], end[2];
    HADA_TRY(trace(light, patch, err));
    box(light, first, end);
    for (int r = 0; r < light->rows; r++)
        for (int c = 0; c < light->cols; c++) {
            const size_t at = (size_t)r * (size_t)light->cols + (size_t)c;
            const int inside = r >= first[0] && r < end[0] && c >= first[1] && c < end[1];
            if (light->all[at] > light->least)
                share[at] = inside ? (float)(hada_rays_at(&light->rays, r, c) / light->all[at]) : 0.0f;
            else
                share[at] = (float)(labels[at] == patch);
        }
    return HADA_OK;
}

typedef struct occluded {
    hada_simulator *simulator;
    const hada_layer *layers;
    int count, lens;
    double gap;
    const unsigned char *reach;
    hada_lenses lenses;
    int *labels;  /* of the transform's grid */
    float *share; /* of the light of a pixel of that grid: what one lens makes */
    hada_patch_light patch_light;
    hada_buffer opaque;  /* opacities of all planes that have one, field after field */
    hada_buffer seen;    /* a plane as one lens sees it, channels x field */
    hada_buffer weights; /* of one lens */
    hada_buffer otf;     /* of one lens */
    int any;             /* light is in the frame's spectrum */
} occluded;

static hada_status check_opacity(const hada_image *opacity, const hada_image *image, hada_error *err)
{
    HADA_TRY(hada_image_check(opacity, NULL, "a scene", "an opacity", err));
    if (opacity->channels != 1 || opacity->rows != image->rows || opacity->cols != image->cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "an opacity of %d channels, %d x %d does not fit its plane; it must have 1 channel, %d x %d",
                         opacity->channels, opacity->rows, opacity->cols, image->rows, image->cols);
    for (size_t i = 0; i < hada_image_count(opacity); i++)
        if (!(opacity->data[i] >= 0.0f && opacity->data[i] <= 1.0f))
            return hada_fail(err, HADA_ERROR_ARGUMENT, "an opacity of %g is not possible; it must be from 0 to 1",
                             (double)opacity->data[i]);
    return HADA_OK;
}

/* Whether layer j hides something of layer i. */
static int hides(const occluded *o, int j, int i)
{
    const hada_layer *near = &o->layers[j], *far = &o->layers[i];
    if (!near->opacity || !(near->place.distance_mm < far->place.distance_mm))
        return 0;
    if (o->gap > 0.0 && !(1.0 / near->place.distance_mm - 1.0 / far->place.distance_mm > o->gap))
        return 0;
    return !o->reach || o->reach[(size_t)i * (size_t)o->count + (size_t)j];
}

static int is_hidden(const occluded *o, int i)
{
    for (int j = 0; j < o->count; j++)
        if (hides(o, j, i))
            return 1;
    return 0;
}

static size_t field_pixels(const occluded *o)
{
    return (size_t)o->simulator->field.rows * (size_t)o->simulator->field.cols;
}

/* The side of a patch, so that neighbours see the farthest plane move no more than patch_pixels on the nearest. */
static double patch_side(const occluded *o)
{
    const hada_camera *camera = &o->simulator->camera;
    double most = 0.0, cols, rows;
    for (int i = 0; i < o->count; i++)
        for (int j = 0; j < o->count; j++)
            if (hides(o, j, i)) {
                hada_camera_parallax(camera, o->layers[j].place.distance_mm, o->layers[i].place.distance_mm, 1.0, 0.0,
                                     &cols, &rows);
                most = fmax(most, cols);
            }
    return most > 0.0 ? o->simulator->patch_pixels / most : camera->aperture_mm;
}

static hada_status prepare(occluded *o, hada_error *err)
{
    hada_simulator *s = o->simulator;
    hada_context *context = s->slot->context;
    const size_t pixels = (size_t)s->rows * (size_t)s->cols;
    HADA_TRY(hada_lenses_create(&o->lenses, &s->camera, patch_side(o), s->monitor, err));
    if (o->lens != -1 && o->lenses.side > 0.0)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT,
                           "a mask of kind '%s' has no lens %d to look through; use -1, the whole mask",
                           hada_enum_name(HADA_ENUM_MASK, (int)s->camera.mask), o->lens));
    if (o->lens < -1 || o->lens >= o->lenses.count)
        HADA_TRY(hada_fail(err, HADA_ERROR_ARGUMENT, "lens %d is not among the camera's %d lenses (-1: all)", o->lens,
                           o->lenses.count));
    HADA_TRY(HADA_NEW(o->labels, pixels, "the parts of a PSF", err));
    HADA_TRY(HADA_NEW(o->share, pixels, "the parts of a PSF", err));
    const size_t bytes = field_pixels(o) * sizeof(float);
    HADA_TRY(hada_buffer_create(&o->opaque, context, bytes * (size_t)o->count, "opacities", err));
    HADA_TRY(hada_buffer_create(&o->seen, context, bytes * (size_t)s->camera.channels, "a view", err));
    for (int i = 0; i < o->count; i++)
        if (o->layers[i].opacity)
            HADA_TRY(hada_simulator_upload(s, o->layers[i].opacity, 1, &o->opaque, (size_t)i * field_pixels(o), err));
    return HADA_OK;
}

/* The plane on the device as one lens sees it, from s->scene to o->seen. */
static hada_status hide(occluded *o, int i, int lens, hada_error *err)
{
    hada_simulator *s = o->simulator;
    cl_mem light = s->scene.mem;
    hada_taps taps = {0};
    hada_status status = HADA_OK;
    for (int j = 0; j < o->count; j++) {
        if (!hides(o, j, i))
            continue;
        hada_taps_destroy(&taps);
        HADA_TRY_OR_DONE(hada_taps_create(&taps, &s->camera, &o->lenses, lens, o->layers[j].place.distance_mm,
                                          o->layers[i].place.distance_mm, err));
        hada_buffer_destroy(&o->weights);
        HADA_TRY_OR_DONE(hada_buffer_create_from(&o->weights, s->slot, taps.weight,
                                                 (size_t)taps.rows * (size_t)taps.cols * sizeof(float),
                                                 "the view of a lens", err));
        HADA_TRY_OR_DONE(hada_optics_hide(s->slot, light, o->seen.mem, 0, o->opaque.mem, (size_t)j * field_pixels(o),
                                          o->weights.mem, &taps, s->camera.channels, s->field.rows, s->field.cols,
                                          err));
        light = o->seen.mem;
    }
done:
    hada_taps_destroy(&taps);
    return status;
}

static hada_status add_lens(occluded *o, int i, const hada_image *psf, int lens, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const int channels = s->camera.channels;
    cl_mem light = is_hidden(o, i) ? o->seen.mem : s->scene.mem;
    if (o->lenses.side > 0.0)
        HADA_TRY(patch_light_share(&o->patch_light, lens, o->labels, o->share, err));
    else
        for (size_t k = 0; k < (size_t)s->rows * (size_t)s->cols; k++)
            o->share[k] = (float)(o->labels[k] == lens);
    HADA_TRY(hada_simulator_make_otf(s, psf, o->share, &o->otf, err));
    HADA_TRY(hide(o, i, lens, err));
    HADA_TRY(hada_fft_forward(s->forward_scene, channels, light, 0, s->spectrum.mem, 0, err));
    HADA_TRY(hada_optics_accumulate(s->slot, s->sum.mem, 0, o->otf.mem, s->psf_images, s->spectrum.mem, channels,
                                    s->layout.count, o->any, err));
    o->any = 1;
    return HADA_OK;
}

/* A layer that nothing hides, through all lenses. */
static hada_status add_whole(occluded *o, const hada_layer *layer, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const hada_buffer *otf;
    HADA_TRY(hada_simulator_otf(s, layer->place, &o->otf, &otf, err));
    HADA_TRY(hada_simulator_add_image(s, layer->image, otf, o->any, err));
    o->any = 1;
    return HADA_OK;
}

static hada_status add_layer(occluded *o, int i, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const hada_layer *layer = &o->layers[i];
    if (!layer->image)
        return HADA_OK;
    if (o->lens < 0 && !is_hidden(o, i))
        return add_whole(o, layer, err);
    hada_image psf = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_simulator_place_psf(s, layer->place, s->rows, s->cols, &psf, err));
    const double distance = layer->place.distance_mm;
    const int row = s->rows / 2 - s->shift.rows, col = s->cols / 2 - s->shift.cols;
    hada_lens_labels(&s->camera, &o->lenses, distance, s->rows, s->cols, row, col, o->labels);
    if (o->lenses.side > 0.0)
        HADA_TRY_OR_DONE(patch_light_make(&o->patch_light, &o->lenses, distance, s->rows, s->cols, row, col, err));
    HADA_TRY_OR_DONE(hada_simulator_upload(s, layer->image, s->camera.channels, &s->scene, 0, err));
    for (int lens = 0; lens < o->lenses.count; lens++)
        if (o->lens < 0 || lens == o->lens)
            HADA_TRY_OR_DONE(add_lens(o, i, &psf, lens, err));
done:
    patch_light_free(&o->patch_light);
    hada_image_destroy(&psf);
    return status;
}

/* The frame's spectrum of layers that hide each other: opaque ones hide those that lie behind by more than `gap`
 * (1/mm). `reach`, where given, has a row of `count` for each layer: which of the others can hide some of its light at
 * all. `lens` as for hada_simulator_render_occluded. */
static hada_status simulator_add_layers(hada_simulator *s, const hada_layer *layers, int count, int lens, double gap,
                                        const unsigned char *reach, hada_error *err)
{
    occluded o = {.simulator = s, .layers = layers, .count = count, .lens = lens, .gap = gap, .reach = reach};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(prepare(&o, err));
    for (int i = 0; i < count; i++)
        HADA_TRY_OR_DONE(add_layer(&o, i, err));
done:
    if (status)
        hada_slot_finish(s->slot, NULL);
    HADA_DESTROY_BUFFERS(&o.opaque, &o.seen, &o.weights, &o.otf);
    hada_lenses_destroy(&o.lenses);
    HADA_FREE(o.labels, o.share);
    return status;
}

hada_status hada_simulator_render_occluded(hada_simulator *s, const hada_plane *planes,
                                           const hada_image *const *opacity, int count, int lens, double noise,
                                           uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    HADA_NEED(s && planes && raw, err);
    *raw = (hada_image){0};
    HADA_TRY(hada_varying_none(s, err));
    if (count < 1 || !(noise >= 0.0 && isfinite(noise)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d planes with noise %g is not possible", count, noise);
    hada_layer *layers = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(layers, (size_t)count, "a scene", err));
    for (int i = 0; i < count; i++) {
        HADA_TRY_OR_DONE(hada_simulator_check_plane(s, &planes[i], err));
        if (opacity && opacity[i])
            HADA_TRY_OR_DONE(check_opacity(opacity[i], planes[i].image, err));
        layers[i] =
            (hada_layer){hada_simulator_place(s, planes[i].depth), planes[i].image, opacity ? opacity[i] : NULL};
    }
    HADA_TRY_OR_DONE(simulator_add_layers(s, layers, count, lens, 0.0, NULL, err));
    HADA_TRY_OR_DONE(hada_simulator_finish(s, noise, noise_seed, raw, err));
done:
    free(layers);
    return status;
}

/* Scenes on surfaces: every pixel at its own distance. */

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

/* Whether there is light within a square of `radius` pixels about an opaque pixel. */
static int is_near(const hada_image *light, const int *sums, int radius)
{
    const int rows = light->rows, cols = light->cols, wide = cols + 1;
    const size_t plane = (size_t)rows * (size_t)cols;
    for (size_t i = 0; i < hada_image_count(light); i++) {
        if (!(light->data[i] > 0.0f))
            continue;
        const int r = (int)(i % plane) / cols, c = (int)(i % plane) % cols;
        const int top = hada_within(r - radius, rows + 1) * wide, bottom = hada_within(r + radius + 1, rows + 1) * wide,
                  left = hada_within(c - radius, cols + 1), right = hada_within(c + radius + 1, cols + 1);
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
        simulator_add_layers(all->simulator, on.layers, on.count, -1, OPAQUE_STEPS * all->step, on.reach, err));
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
