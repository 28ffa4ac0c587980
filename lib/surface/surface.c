/* A surface: what it is made of, its levels from coarse to fine, and the search for it in a frame. */
#include "surface/surface.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"
#include "refine/proximal.h"
#include "surface/level.h"

static const char what[] = "a surface";

typedef struct hada_surface_level {
    hada_surface_plan plan;
    hada_volume *volume;
    hada_buffer spectrum, pixels; /* of the frame, where the level has a grid of its own */
    hada_fft *inverse;            /* padded: to the pixels */
} hada_surface_level;

struct hada_surface {
    hada_slot *slot;
    hada_surface_camera camera;
    hada_spectrum_layout layout;
    hada_surface_level level[HADA_SURFACE_LEVELS];
    int levels;
    hada_buffer map, texture, allowed; /* depth in planes, of the last level; the texture; masks of planes */
    double *light;                     /* [channel] H(0) of the middle depth */
    double *shift;                     /* [depth] rms, of light from a depth to the next, in pixels */
    float *power;                      /* [count] mean over channels of the middle depth's |H|^2 */
    double gradient_power;             /* of white noise in the gradient of the texture's data term, by a run's rule */
    /* on the host: planes of a level and of the one before, masks; maps of a level and of the one before, in depths of
     * the camera from the first plane on; textures */
    float *planes[2], *mask, *depth[2], *sum, *image[2], *confidence;
    unsigned char *outside;
};

static size_t area_of(const hada_surface_plan *plan)
{
    return (size_t)plan->shape.window.rows * (size_t)plan->shape.window.cols;
}

/* Values of the planes of a level. */
static size_t values_of(const hada_surface_plan *plan)
{
    return (size_t)plan->shape.planes * (size_t)plan->shape.channels * area_of(plan);
}

/* A buffer of so many floats that another object holds. */
static hada_buffer view_of(const hada_surface *s, cl_mem mem, size_t values)
{
    return (hada_buffer){.context = s->slot->context, .mem = mem, .bytes = values * sizeof(float), .part = 1};
}

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

/* Hands a level the frame, brought to its grid. */
static hada_status level_load(hada_surface_level *level, hada_slot *slot, const hada_spectrum_layout *from,
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

/* Values of the planes and of the largest window, of all levels at most; of the texture. */
typedef struct sizes {
    size_t values, area, texture;
} sizes;

static sizes sizes_of(const hada_surface_plan *plans, int levels)
{
    const hada_surface_plan *last = &plans[levels - 1];
    sizes n = {.texture = (size_t)last->shape.channels * area_of(last)};
    for (int l = 0; l < levels; l++) {
        n.area = area_of(&plans[l]) > n.area ? area_of(&plans[l]) : n.area;
        if (l + 1 < levels && values_of(&plans[l]) > n.values)
            n.values = values_of(&plans[l]);
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
    const hada_buffer otf = view_of(s, s->camera.otf, (s->camera.first + (size_t)(depths * channels)) * count * 2);
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

/* A pixel's light is smoothed by so many pixels before its centre of mass is taken. */
#define BLUR 0.5
/* A level between holds planes up to so many depths of the camera from what the coarser one found near a pixel. */
#define BAND 1.5
/* Depths of neighbouring pixels further apart than this, in depths of the camera, stand on both sides of a jump. */
#define JUMP 1.0
/* Largest curvatures of the data terms: of planes their number and this, of a texture. */
#define PLANES_BOUND  0.5
#define TEXTURE_BOUND 1.5
/* The same with weights of pixels, which mix strong frequencies into weak ones that count more. With 1.5 some saturated
 * frames went astray slowly, which is not seen in few steps. */
#define TEXTURE_BOUND_WEIGHED 3.0
/* Weaker than that of a plane: where depths jump, total variation holds a texture that shrinkage alone would not
 * (docs/explanation/surfaces.md). */
#define TEXTURE_SHRINK    0.7
#define TEXTURE_SHRINK_TV 0.6
/* A depth that lies so far beyond those of the camera is none that it knows. */
#define OUTSIDE 0.3F
/* A coarse level leaves no hope for the finer ones where all its planes leave this part of what is enough, for then the
 * camera does not fit its frame, and its one texture so many times that, with this part of the frame's energy beside it
 * for what is wrong with depths so coarse (docs/explanation/surfaces.md). */
#define MISFIT         0.5
#define HOPELESS       1.15
#define HOPELESS_FRAME 0.002
/* Pixels on each side of one over which the texture says how sure its depth is. */
enum { SURE_RADIUS = 2 };

void hada_surface_rule_init(hada_surface_rule *rule)
{
    *rule = (hada_surface_rule){.first_steps = 70,
                                .band_steps = 80,
                                .texture_steps = 12,
                                .floor = 0.003,
                                .first_variation = 0.0075,
                                .band_variation = 0.15,
                                .texture_variation = 1.4};
}

static hada_map_size size_of(const hada_surface_plan *plan)
{
    return (hada_map_size){plan->shape.window.rows, plan->shape.window.cols};
}

/* The scene's mean, over its window and channels, by the frame's light over the PSF's. */
static hada_status mean_light(const hada_surface *s, cl_mem spectrum, size_t offset, double *mean, hada_error *err)
{
    const size_t channels = (size_t)s->camera.channels;
    const hada_buffer view = view_of(s, spectrum, 2 * (offset + channels * s->layout.count));
    float *value = s->image[0]; /* which stays, should a read fail */
    double sum = 0.0;
    for (size_t c = 0; c < channels; c++) {
        const size_t at = (offset + c * s->layout.count) * 2 * sizeof *value;
        HADA_TRY(hada_buffer_read_later(&view, s->slot, at, value + c, sizeof *value, err));
    }
    HADA_TRY(hada_slot_finish(s->slot, err));
    for (size_t c = 0; c < channels; c++)
        sum += s->light[c] > 0.0 ? value[c] / s->light[c] : 0.0;
    *mean = sum / ((double)channels * (double)area_of(&s->level[s->levels - 1].plan));
    return HADA_OK;
}

/* A level's planes on the device. */
static hada_buffer planes_of(const hada_surface *s, const hada_surface_level *level)
{
    return view_of(s, hada_volume_planes(level->volume), values_of(&level->plan));
}

/* The planes that a level starts from, where they are allowed: those of the coarser one, interpolated; where it has
 * more of them, its light is shared out. */
static void start_planes(hada_surface *s, const hada_surface_plan *from, const hada_surface_plan *to)
{
    const hada_map_place place = hada_surface_level_place(to, from);
    const size_t few = area_of(from), many = area_of(to), channels = (size_t)to->shape.channels;
    const double share = (double)from->steps / to->steps;
    float *blend = s->image[0];
    for (int k = 0; k < to->shape.planes; k++) {
        const double at = (double)k * from->steps / to->steps, part = at - floor(at);
        const size_t low = (size_t)at, high = part > 0.0 ? low + 1 : low;
        if (at > from->shape.planes - 1) {
            memset(s->planes[1] + (size_t)k * channels * many, 0, channels * many * sizeof *s->planes[1]);
            continue;
        }
        for (size_t c = 0; c < channels; c++) {
            const float *a = s->planes[0] + (low * channels + c) * few, *b = s->planes[0] + (high * channels + c) * few;
            float *out = s->planes[1] + ((size_t)k * channels + c) * many;
            for (size_t i = 0; i < few; i++)
                blend[i] = (float)(share * ((1.0 - part) * a[i] + part * b[i]));
            hada_map_resample(blend, size_of(from), out, size_of(to), &place);
            for (size_t i = 0; i < many; i++)
                out[i] *= s->mask[((size_t)k * channels + c) * many + i];
        }
    }
    float *other = s->planes[0];
    s->planes[0] = s->planes[1];
    s->planes[1] = other;
}

/* Masks of planes for all channels, from those for one that stand before them. */
static void spread_mask(float *mask, int planes, size_t channels, size_t area)
{
    for (size_t k = (size_t)planes; k-- > 0;)
        for (size_t c = channels; c-- > 0;)
            memmove(mask + (k * channels + c) * area, mask + k * area, area * sizeof *mask);
}

static int is_dark(const float *plane, size_t area)
{
    for (size_t i = 0; i < area; i++)
        if (plane[i] > 0.0F)
            return 0;
    return 1;
}

/* The planes of a mask for one channel that are allowed anywhere. */
static void find_range(const float *mask, int planes, size_t area, hada_volume_band *band)
{
    band->first = 0;
    band->last = planes - 1;
    while (band->first < band->last && is_dark(mask + (size_t)band->first * area, area))
        band->first++;
    while (band->last > band->first && is_dark(mask + (size_t)band->last * area, area))
        band->last--;
}

/* What a level may fill, and what it starts from, by the one before. */
static hada_status follow(hada_surface *s, int l, hada_volume_band *band, hada_error *err)
{
    const hada_surface_plan *from = &s->level[l - 1].plan, *to = &s->level[l].plan;
    const hada_map_place place = hada_surface_level_place(to, from);
    hada_buffer planes = planes_of(s, &s->level[l]);
    const size_t bytes = values_of(to) * sizeof(float);
    HADA_TRY(hada_map_band(s->depth[0], size_of(from), to->steps, BAND, to->shape.planes, size_of(to), &place, s->mask,
                           err));
    find_range(s->mask, to->shape.planes, area_of(to), band);
    spread_mask(s->mask, to->shape.planes, (size_t)to->shape.channels, area_of(to));
    start_planes(s, from, to);
    HADA_TRY(hada_buffer_write_later(&s->allowed, s->slot, 0, s->mask, bytes, err));
    return hada_buffer_write_later(&planes, s->slot, 0, s->planes[0], bytes, err);
}

/* The sum of a level's planes. */
static void add_planes(const hada_surface *s, const hada_surface_plan *plan, float *image)
{
    const size_t values = (size_t)plan->shape.channels * area_of(plan);
    memset(image, 0, values * sizeof *image);
    for (int k = 0; k < plan->shape.planes; k++)
        for (size_t i = 0; i < values; i++)
            image[i] += s->planes[0][(size_t)k * values + i];
}

/* Pixels of a level's frame, of all channels. */
static double frame_pixels(const hada_surface_plan *plan)
{
    const hada_volume_shape *shape = &plan->shape;
    const int padded = shape->boundary == HADA_BOUNDARY_PADDED;
    return (padded ? (double)shape->frame.rows * shape->frame.cols : (double)shape->rows * shape->cols) *
           shape->channels;
}

/* The sum over frequencies of what the data term's gradient makes of white noise of variance 1. */
static double gradient_power(const hada_surface *s, double floor)
{
    double sum = 0.0;
    for (int ky = 0; ky < s->layout.rows; ky++)
        for (int kx = 0; kx <= s->layout.cols / 2; kx++) {
            const double power = s->power[hada_spectrum_index(&s->layout, ky, kx)];
            const double weight = 1.0 / (power + floor * s->power[0] + 1e-300);
            sum += weight * weight * power;
        }
    return sum;
}

/* Pixels of the whole grid for one of a level. */
static double fewer_pixels(const hada_surface *s, const hada_surface_plan *level)
{
    return (double)s->camera.rows * s->camera.cols / ((double)level->shape.rows * level->shape.cols);
}

/* Standard deviation of the noise in the gradient of the texture's data term where noise has this energy in a frame of
 * so many pixels. */
static double gradient_noise(const hada_surface *s, double energy, double pixels)
{
    return sqrt(energy / pixels * s->gradient_power / ((double)s->layout.rows * (s->layout.cols / 2 + 1)));
}

/* The same by what a level left of its frame: of a coarser frame's pixels noise has less, as they are fewer. */
static double noise_of(const hada_surface *s, int l, const hada_surface_result *result)
{
    const hada_surface_plan *level = &s->level[l].plan;
    return gradient_noise(s, fewer_pixels(s, level) * result->energy[l], frame_pixels(level));
}

/* Planes of a level, and the depths, in depths of the camera, at which their light stands. */
static hada_status solve_planes(hada_surface *s, int l, const hada_surface_rule *rule, double mean,
                                hada_surface_result *result, hada_error *err)
{
    const hada_surface_plan *plan = &s->level[l].plan;
    const hada_volume_rule solve = {.steps = l ? rule->band_steps : rule->first_steps,
                                    .floor = rule->floor,
                                    .variation = l ? rule->band_variation * noise_of(s, l - 1, result)
                                                   : rule->first_variation * mean,
                                    .bound = plan->shape.planes + PLANES_BOUND};
    hada_buffer planes = planes_of(s, &s->level[l]);
    hada_volume_band band = {.allowed = s->allowed.mem};
    hada_map_rule smooth;
    hada_map_rule_init(&smooth);
    if (l)
        HADA_TRY(follow(s, l, &band, err));
    else
        HADA_TRY(hada_buffer_clear(&planes, s->slot, 0, values_of(plan) * sizeof(float), err));
    HADA_TRY(hada_volume_solve(s->level[l].volume, &solve, l ? &band : NULL, &result->energy[l], err));
    HADA_TRY(hada_buffer_read(&planes, s->slot, 0, s->planes[0], values_of(plan) * sizeof(float), err));
    HADA_TRY(hada_map_centre(s->planes[0], plan->shape.planes, plan->shape.channels, size_of(plan), BLUR, s->depth[0],
                             s->sum, err));
    for (size_t i = 0; i < area_of(plan); i++)
        s->depth[0][i] /= (float)plan->steps;
    if (l + 2 < s->levels)
        return HADA_OK;
    add_planes(s, plan, s->image[0]);
    HADA_TRY(hada_map_sharpen(s->depth[0], s->sum, size_of(plan), JUMP, err));
    HADA_TRY(hada_map_smooth(s->depth[0], s->sum, s->image[0], plan->shape.channels, size_of(plan), &smooth, err));
    return HADA_OK;
}

/* The first and last of so many planes that depths, in planes, touch. */
static void touched(const float *depth, size_t area, int planes, int *first, int *last)
{
    float least = INFINITY, most = 0.0F;
    for (size_t i = 0; i < area; i++) {
        least = fminf(least, depth[i]);
        most = fmaxf(most, depth[i]);
    }
    *first = (int)least;
    *last = (int)most + 1 < planes ? (int)most + 1 : planes - 1;
}

/* Whether going on from a coarse level is in vain: its planes, and one texture at the depths that it found, leave too
 * much already of what the level sees of the frame. Its planes stay as they were on the host, which the next level
 * begins with. */
static hada_status look_ahead(hada_surface *s, int l, const hada_surface_rule *rule, hada_surface_result *result,
                              hada_error *err)
{
    const hada_surface_plan *plan = &s->level[l].plan;
    const size_t area = area_of(plan), values = area * (size_t)plan->shape.channels;
    const double noise = gradient_noise(s, result->energy[l], frame_pixels(plan));
    const hada_volume_rule solve = {.steps = rule->texture_steps,
                                    .floor = rule->floor,
                                    .variation = rule->texture_variation * noise,
                                    .bound = TEXTURE_BOUND};
    const double pixels = fewer_pixels(s, plan);
    const double planes = pixels * result->energy[l] / (MISFIT * rule->enough);
    double texture = 0.0;
    int first, last;
    if (!(planes > 1.0))
        goto said;
    add_planes(s, plan, s->image[0]);
    for (size_t i = 0; i < area; i++)
        s->sum[i] = fminf(fmaxf(s->depth[0][i] * (float)plan->steps, 0.0F), (float)(plan->shape.planes - 1));
    touched(s->sum, area, plan->shape.planes, &first, &last);
    HADA_TRY(hada_buffer_write_later(&s->map, s->slot, 0, s->sum, area * sizeof(float), err));
    HADA_TRY(hada_buffer_write_later(&s->texture, s->slot, 0, s->image[0], values * sizeof(float), err));
    HADA_TRY(hada_volume_texture(s->level[l].volume, &solve, s->map.mem, first, last, s->texture.mem, &texture, err));
    texture *= pixels / (HOPELESS * rule->enough + HOPELESS_FRAME * rule->frame);
    result->in_vain = texture > 1.0;
said:
    hada_log(s->slot->context, HADA_LOG_INFO,
             "a surface at %d x %d pixels: planes %.3f, texture %.3f of what ends it%s", plan->shape.rows,
             plan->shape.cols, planes, texture, result->in_vain ? "; it is given up" : "");
    return HADA_OK;
}

/* Brings depths to the window's pixels, and the planes' sum as the texture to start from; says which planes the depths
 * touch. */
static hada_status begin_texture(hada_surface *s, int *first, int *last, hada_error *err)
{
    const hada_surface_plan *from = &s->level[s->levels - 2].plan, *to = &s->level[s->levels - 1].plan;
    const hada_map_place place = hada_surface_level_place(to, from);
    const size_t area = area_of(to);
    const float end = (float)(s->camera.depths - 1);
    add_planes(s, from, s->image[0]);
    for (size_t c = 0; c < (size_t)to->shape.channels; c++)
        hada_map_resample(s->image[0] + c * area_of(from), size_of(from), s->image[1] + c * area, size_of(to), &place);
    hada_map_resample(s->depth[0], size_of(from), s->depth[1], size_of(to), &place);
    for (size_t i = 0; i < area; i++) {
        s->sum[i] = fminf(fmaxf(s->depth[1][i] * (float)to->steps, 0.0F), (float)(to->shape.planes - 1));
        const float depth = s->depth[1][i] - (float)to->before;
        s->outside[i] = depth < -OUTSIDE || depth > end + OUTSIDE;
        s->depth[1][i] = fminf(fmaxf(depth, 0.0F), end);
    }
    touched(s->sum, area, to->shape.planes, first, last);
    HADA_TRY(hada_buffer_write_later(&s->map, s->slot, 0, s->sum, area * sizeof(float), err));
    return hada_buffer_write_later(&s->texture, s->slot, 0, s->image[1],
                                   area * (size_t)to->shape.channels * sizeof(float), err);
}

static hada_status solve_texture(hada_surface *s, const hada_surface_rule *rule, int weighed,
                                 hada_surface_result *result, hada_error *err)
{
    const hada_surface_plan *plan = &s->level[s->levels - 1].plan;
    const hada_volume_rule solve = {.steps = rule->texture_steps,
                                    .floor = rule->floor,
                                    .variation = rule->texture_variation * noise_of(s, s->levels - 2, result),
                                    .shrink = TEXTURE_SHRINK,
                                    .shrink_tv = TEXTURE_SHRINK_TV,
                                    .bound = weighed ? TEXTURE_BOUND_WEIGHED : TEXTURE_BOUND};
    double *energy = &result->energy[s->levels - 1];
    int first, last;
    HADA_TRY(begin_texture(s, &first, &last, err));
    HADA_TRY(hada_volume_texture(s->level[s->levels - 1].volume, &solve, s->map.mem, first, last, s->texture.mem,
                                 energy, err));
    HADA_TRY(hada_buffer_read(&s->texture, s->slot, 0, s->image[0],
                              area_of(plan) * (size_t)plan->shape.channels * sizeof(float), err));
    HADA_TRY(hada_map_confidence(s->image[0], plan->shape.channels, s->depth[1], size_of(plan),
                                 noise_of(s, s->levels - 1, result), s->shift, s->camera.depths, SURE_RADIUS,
                                 s->confidence, err));
    result->touched = last - first + 1;
    return HADA_OK;
}

/* A frame without light: nothing anywhere, at no depth. */
static hada_status nothing(hada_surface *s, hada_error *err)
{
    const hada_surface_plan *plan = &s->level[s->levels - 1].plan;
    const size_t area = area_of(plan);
    memset(s->confidence, 0, area * sizeof *s->confidence);
    memset(s->outside, 0, area);
    for (size_t i = 0; i < area; i++)
        s->depth[1][i] = (float)(s->camera.depths - 1) / 2.0F;
    return hada_buffer_clear(&s->texture, s->slot, 0, area * (size_t)plan->shape.channels * sizeof(float), err);
}

hada_status hada_surface_run(hada_surface *s, const hada_surface_frame *frame, const hada_surface_rule *rule,
                             hada_surface_result *result, hada_error *err)
{
    const hada_surface_plan *last = &s->level[s->levels - 1].plan;
    double mean;
    *result =
        (hada_surface_result){.rows = last->shape.window.rows,
                              .cols = last->shape.window.cols,
                              .depth = s->depth[1],
                              .confidence = s->confidence,
                              .outside = s->outside,
                              .texture = s->texture.mem,
                              .levels = s->levels,
                              .steps = rule->first_steps + (s->levels - 2) * rule->band_steps + rule->texture_steps};
    HADA_TRY(mean_light(s, frame->spectrum, frame->spectrum_offset, &mean, err));
    if (!(mean > 0.0)) {
        HADA_TRY(nothing(s, err));
        return HADA_OK;
    }
    for (int l = 0; l < s->levels; l++)
        HADA_TRY(level_load(&s->level[l], s->slot, &s->layout, frame, err));
    s->gradient_power = gradient_power(s, rule->floor);
    for (int l = 0; l + 1 < s->levels && !result->in_vain; l++) {
        HADA_TRY(solve_planes(s, l, rule, mean, result, err));
        if (rule->enough > 0.0 && l + 2 < s->levels) /* the last planes cost too little of what is left */
            HADA_TRY(look_ahead(s, l, rule, result, err));
    }
    if (!result->in_vain)
        HADA_TRY(solve_texture(s, rule, frame->weights != NULL, result, err));
    return HADA_OK;
}

hada_status hada_surface_planes(hada_surface *s, cl_mem planes, hada_error *err)
{
    const hada_surface_level *last = &s->level[s->levels - 1];
    HADA_TRY(hada_buffer_write_later(&s->map, s->slot, 0, s->depth[1], area_of(&last->plan) * sizeof(float), err));
    return hada_volume_spread(last->volume, s->map.mem, s->texture.mem, s->camera.depths, planes, err);
}
