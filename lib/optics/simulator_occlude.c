/* Scenes with opaque planes, lens by lens: every lens sees a plane through what the nearer ones leave open for it. */
#include <stdlib.h>

#include "core/alloc.h"
#include "optics/accumulate.h"
#include "optics/occlusion.h"
#include "optics/simulator.h"

typedef struct occluded {
    hada_simulator *simulator;
    const hada_plane *planes;
    const hada_image *const *opacity;
    int count, lens;
    hada_lenses lenses;
    int *labels;         /* of the transform's grid */
    hada_buffer opaque;  /* opacities of all planes that have one, field after field */
    hada_buffer seen;    /* a plane as one lens sees it, channels x field */
    hada_buffer weights; /* of one lens */
    hada_buffer otf;     /* of one lens */
    int any;             /* light stands in the frame's spectrum */
} occluded;

static hada_status check_opacity(const hada_image *opacity, const hada_image *image, hada_error *err)
{
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

/* Whether plane j hides something of plane i. */
static int hides(const occluded *o, int j, int i)
{
    return o->opacity && o->opacity[j] && o->planes[j].depth < o->planes[i].depth;
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

static hada_status prepare(occluded *o, hada_error *err)
{
    hada_simulator *s = o->simulator;
    hada_context *context = s->slot->context;
    void *labels;
    hada_status status = hada_lenses_create(&o->lenses, &s->camera, err);
    if (!status && (o->lens < -1 || o->lens >= o->lenses.count))
        status = hada_fail(err, HADA_ERROR_ARGUMENT, "lens %d is not among the camera's %d lenses (-1: all)", o->lens,
                           o->lenses.count);
    if (status ||
        (status = hada_alloc(&labels, (size_t)s->rows * (size_t)s->cols, sizeof(int), "the parts of a PSF", err)))
        return status;
    o->labels = labels;
    const size_t bytes = field_pixels(o) * sizeof(float);
    if ((status = hada_buffer_create(&o->opaque, context, bytes * (size_t)o->count, "opacities", err)) ||
        (status = hada_buffer_create(&o->seen, context, bytes * (size_t)s->camera.channels, "a view", err)))
        return status;
    for (int i = 0; i < o->count && !status; i++)
        if (o->opacity && o->opacity[i])
            status = hada_simulator_upload(s, o->opacity[i], 1, &o->opaque, (size_t)i * field_pixels(o), err);
    return status;
}

/* The plane on the device as one lens sees it, from s->scene to o->seen. */
static hada_status hide(occluded *o, int i, int lens, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const double *distances = s->camera.distances_mm;
    cl_mem light = s->scene.mem;
    hada_status status = HADA_OK;
    for (int j = 0; j < o->count && !status; j++) {
        if (!hides(o, j, i))
            continue;
        hada_taps taps;
        if ((status = hada_taps_create(&taps, &s->camera, &o->lenses, lens, distances[o->planes[j].depth],
                                       distances[o->planes[i].depth], err)))
            return status;
        hada_buffer_destroy(&o->weights);
        status =
            hada_buffer_create_from(&o->weights, s->slot, taps.weight,
                                    (size_t)taps.rows * (size_t)taps.cols * sizeof(float), "the view of a lens", err);
        if (!status)
            status = hada_optics_hide(s->slot, light, o->seen.mem, 0, o->opaque.mem, (size_t)j * field_pixels(o),
                                      o->weights.mem, &taps, s->camera.channels, s->field.rows, s->field.cols, err);
        light = o->seen.mem;
        hada_taps_destroy(&taps);
    }
    return status;
}

static hada_status add_lens(occluded *o, int i, const hada_image *psf, int lens, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const int channels = s->camera.channels;
    cl_mem light = is_hidden(o, i) ? o->seen.mem : s->scene.mem;
    hada_status status = hada_simulator_make_otf(s, psf, o->labels, lens, &o->otf, err);
    if (status || (status = hide(o, i, lens, err)) ||
        (status = hada_fft_forward(s->forward_scene, channels, light, 0, s->spectrum.mem, 0, err)))
        return status;
    status = hada_optics_accumulate(s->slot, s->sum.mem, 0, o->otf.mem, s->psf_images, s->spectrum.mem, channels,
                                    s->layout.count, o->any, err);
    o->any = 1;
    return status;
}

static hada_status add_plane(occluded *o, int i, hada_error *err)
{
    hada_simulator *s = o->simulator;
    const hada_plane *plane = &o->planes[i];
    if (o->lens < 0 && !is_hidden(o, i)) {
        const hada_status status = hada_simulator_add_plane(s, plane, o->any, err);
        o->any = 1;
        return status;
    }
    hada_image psf;
    hada_status status = hada_simulator_place_psf(s, plane->depth, s->rows, s->cols, &psf, err);
    if (status)
        return status;
    hada_lens_labels(&s->camera, &o->lenses, s->camera.distances_mm[plane->depth], s->rows, s->cols,
                     s->rows / 2 - s->shift.rows, s->cols / 2 - s->shift.cols, o->labels);
    status = hada_simulator_upload(s, plane->image, s->camera.channels, &s->scene, 0, err);
    for (int lens = 0; lens < o->lenses.count && !status; lens++)
        if (o->lens < 0 || lens == o->lens)
            status = add_lens(o, i, &psf, lens, err);
    hada_image_destroy(&psf);
    return status;
}

hada_status hada_simulator_render_occluded(hada_simulator *s, const hada_plane *planes,
                                           const hada_image *const *opacity, int count, int lens, double noise,
                                           uint64_t noise_seed, hada_image *raw, hada_error *err)
{
    *raw = (hada_image){0};
    if (count < 1 || !(noise >= 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a scene of %d planes with noise %g is not possible", count, noise);
    occluded o = {.simulator = s, .planes = planes, .opacity = opacity, .count = count, .lens = lens};
    hada_status status = HADA_OK;
    for (int i = 0; i < count && !status; i++)
        if (!(status = hada_simulator_check_plane(s, &planes[i], err)) && opacity && opacity[i])
            status = check_opacity(opacity[i], planes[i].image, err);
    if (!status)
        status = prepare(&o, err);
    for (int i = 0; i < count && !status; i++)
        status = add_plane(&o, i, err);
    if (!status)
        status = hada_simulator_finish(s, noise, noise_seed, raw, err);
    if (status)
        hada_slot_finish(s->slot, NULL);
    hada_buffer_destroy(&o.opaque);
    hada_buffer_destroy(&o.seen);
    hada_buffer_destroy(&o.weights);
    hada_buffer_destroy(&o.otf);
    hada_lenses_destroy(&o.lenses);
    free(o.labels);
    return status;
}
