/* Point spread functions that vary over the field, exactly: each point of a scene has its own. The light that reaches a
 * pixel q of the PSF of the middle goes to q + D for a point at p from the axis, D = a (|p| / R) M(q) p / R, R the
 * window's half diagonal: an aberration that grows with the square of the field angle, as astigmatism and field
 * curvature do (Born and Wolf, Principles of Optics, 5.3), and is another one for each part of the mask, as M, a matrix
 * drawn from the camera's seed, varies over the PSF. Light falls between four pixels in linear shares; none is lost but
 * what misses the sensor. The size a is found from the correlation that the PSFs of the middle and of a corner of the
 * window shall have. On the host: a frame costs a term for each pair of a bright pixel of the scene and one of the PSF.
 */

#include "core/callers.h"
#include "core/random.h"
#include "optics/simulator.h"

enum { PARTS = 8 /* of the sensor's sides, between which M changes smoothly */, BISECTIONS = 40 };

/* A bright pixel of the PSF of the middle. */
typedef struct ray {
    float row, col;     /* from the axis */
    float matrix[4];    /* a M / R^2 */
    const float *light; /* of the first channel */
} ray;

struct hada_varying {
    double size;                                 /* a */
    double matrix[(PARTS + 1) * (PARTS + 1)][4]; /* M */
    hada_image *psf;                             /* of the middle, by depth; empty until first used */
    ray **rays;
    size_t *counts;
};

static double radius_of(const hada_simulator *s)
{
    return 0.5 * hypot(s->camera.window_rows, s->camera.window_cols);
}

/* M at a pixel of the PSF, between those of the lattice. */
static void matrix_at(const hada_simulator *s, double row, double col, double out[4])
{
    const double i = fmin(fmax(PARTS * (row / s->camera.rows + 0.5), 0.0), PARTS * (1.0 - 1e-9)),
                 j = fmin(fmax(PARTS * (col / s->camera.cols + 0.5), 0.0), PARTS * (1.0 - 1e-9));
    const double u = i - floor(i), v = j - floor(j);
    const size_t at = (size_t)i * (PARTS + 1) + (size_t)j;
    const double(*m)[4] = (const double(*)[4])s->varying->matrix;
    for (int k = 0; k < 4; k++)
        out[k] = (1 - u) * ((1 - v) * m[at][k] + v * m[at + 1][k]) +
                 u * ((1 - v) * m[at + PARTS + 1][k] + v * m[at + PARTS + 2][k]);
}

/* The bright pixels of a depth, made when they are first needed. */
static hada_status ready(const hada_simulator *s, int depth, hada_error *err)
{
    hada_varying *v = s->varying;
    hada_image *psf = &v->psf[depth];
    const double scale = radius_of(s) * radius_of(s);
    size_t bright = 0;
    if (v->rays[depth])
        return HADA_OK;
    hada_image_destroy(psf);
    HADA_TRY(hada_simulator_place_psf(s, hada_simulator_place(s, depth), s->rows, s->cols, psf, err));
    const size_t area = (size_t)psf->rows * (size_t)psf->cols;
    HADA_TRY(HADA_NEW(v->rays[depth], area, "a point spread function", err));
    for (size_t i = 0; i < area; i++) {
        double light = 0.0, matrix[4];
        for (int c = 0; c < psf->channels; c++)
            light += fabs(psf->data[(size_t)c * area + i]);
        if (light == 0.0)
            continue;
        ray *now = &v->rays[depth][bright++];
        now->row = (float)((int)(i / (size_t)psf->cols) - psf->rows / 2);
        now->col = (float)((int)(i % (size_t)psf->cols) - psf->cols / 2);
        matrix_at(s, now->row, now->col, matrix);
        for (int k = 0; k < 4; k++)
            now->matrix[k] = (float)(matrix[k] / scale);
        now->light = psf->data + i;
    }
    v->counts[depth] = bright;
    return HADA_OK;
}

/* Pixels from the axis. */
typedef struct point {
    double row, col;
} point;

/* Adds a point of light to a frame, whose middle is the axis, with the aberration of another place. Light of channel c
 * is value[c]. */
static void add_point(const hada_simulator *s, int depth, point at, point field, const float *value, int channels,
                      hada_image *frame)
{
    const hada_varying *v = s->varying;
    const size_t area = (size_t)frame->rows * (size_t)frame->cols,
                 psf_area = (size_t)v->psf[depth].rows * (size_t)v->psf[depth].cols;
    const double far = v->size * hypot(field.row, field.col), down = far * field.row, across = far * field.col;
    const double row0 = at.row + frame->rows / 2, col0 = at.col + frame->cols / 2;
    const int psf_channels = v->psf[depth].channels;
    for (size_t n = 0; n < v->counts[depth]; n++) {
        const ray *now = &v->rays[depth][n];
        const double y = row0 + now->row + now->matrix[0] * down + now->matrix[1] * across;
        const double x = col0 + now->col + now->matrix[2] * down + now->matrix[3] * across;
        if (!(y > -1.0 && y < frame->rows && x > -1.0 && x < frame->cols))
            continue;
        const int i = (int)floor(y), j = (int)floor(x);
        const float u = (float)(y - i), w = (float)(x - j);
        const float share[4] = {(1 - u) * (1 - w), (1 - u) * w, u * (1 - w), u * w};
        for (int k = 0; k < 4; k++) {
            const int to_row = i + k / 2, to_col = j + k % 2;
            if (to_row < 0 || to_col < 0 || to_row >= frame->rows || to_col >= frame->cols)
                continue;
            const size_t to = (size_t)to_row * (size_t)frame->cols + (size_t)to_col;
            for (int c = 0; c < channels; c++)
                frame->data[(size_t)c * area + to] +=
                    share[k] * value[c] * now->light[psf_channels > 1 ? (size_t)c * psf_area : 0];
        }
    }
}

/* The mean correlation of the PSF of the middle and those of the window's corners, each about its own place. */
static hada_status correlation(const hada_simulator *s, double size, double *out, hada_error *err)
{
    hada_varying *v = s->varying;
    const float one[3] = {1.0F, 1.0F, 1.0F};
    const int channels = v->psf[0].channels;
    hada_image middle = {0}, corner = {0};
    hada_status status = HADA_OK;
    *out = 0.0;
    v->size = size;
    for (int k = 0; k < 4; k++) {
        const double row = (k / 2 ? 0.5 : -0.5) * s->camera.window_rows,
                     col = (k % 2 ? 0.5 : -0.5) * s->camera.window_cols;
        double both = 0.0, a = 0.0, b = 0.0;
        HADA_TRY_OR_DONE(hada_image_create(&middle, channels, s->rows, s->cols, err));
        HADA_TRY_OR_DONE(hada_image_create(&corner, channels, s->rows, s->cols, err));
        add_point(s, 0, (point){0.0, 0.0}, (point){0.0, 0.0}, one, channels, &middle);
        add_point(s, 0, (point){0.0, 0.0}, (point){row, col}, one, channels, &corner);
        for (size_t i = 0; i < hada_image_count(&middle); i++) {
            both += (double)middle.data[i] * corner.data[i];
            a += (double)middle.data[i] * middle.data[i];
            b += (double)corner.data[i] * corner.data[i];
        }
        *out += a > 0.0 && b > 0.0 ? both / sqrt(a * b) / 4.0 : 0.0;
        hada_image_destroy(&middle);
        hada_image_destroy(&corner);
    }
done:
    hada_image_destroy(&middle);
    hada_image_destroy(&corner);
    return status;
}

/* The size with which a corner's PSF correlates so much with that of the middle. */
static hada_status find_size(const hada_simulator *s, double wanted, hada_error *err)
{
    double low = 0.0, high = 0.25, now;
    HADA_TRY(correlation(s, high, &now, err));
    while (now > wanted && high < s->camera.rows) {
        low = high;
        high *= 2.0;
        HADA_TRY(correlation(s, high, &now, err));
    }
    if (now > wanted)
        return hada_fail(err, HADA_ERROR_NUMERIC, "no aberration makes PSFs of this camera correlate by %g only",
                         wanted);
    for (int i = 0; i < BISECTIONS && high - low > 1e-6 * high; i++) {
        const double middle = 0.5 * (low + high);
        HADA_TRY(correlation(s, middle, &now, err));
        *(now > wanted ? &low : &high) = middle;
    }
    s->varying->size = 0.5 * (low + high);
    return HADA_OK;
}

hada_status hada_varying_create(hada_simulator *s, double wanted, hada_error *err)
{
    const size_t depths = (size_t)s->camera.depths;
    hada_random random;
    if (!(wanted > 0.0 && wanted < 1.0))
        return hada_fail(
            err, HADA_ERROR_ARGUMENT,
            "options.field_varying is the correlation of PSFs in the middle and in a corner, between 0 and "
            "1, not %g",
            wanted);
    if (s->camera.boundary != HADA_BOUNDARY_PADDED)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "PSFs vary over the field where the sensor crops: take options.boundary padded");
    HADA_TRY(HADA_NEW(s->varying, 1, "a simulator", err));
    hada_varying *v = s->varying;
    HADA_TRY(HADA_NEW(v->psf, depths, "a simulator", err));
    HADA_TRY(HADA_NEW(v->rays, depths, "a simulator", err));
    HADA_TRY(HADA_NEW(v->counts, depths, "a simulator", err));
    hada_random_seed(&random, s->camera.seed, 0x0ab0);
    for (int i = 0; i < (PARTS + 1) * (PARTS + 1); i++)
        for (int k = 0; k < 4; k++)
            v->matrix[i][k] = hada_random_range(&random, -1.0, 1.0);
    HADA_TRY(ready(s, 0, err));
    return find_size(s, wanted, err);
}

hada_status hada_varying_none(const hada_simulator *s, hada_error *err)
{
    return s->varying ? hada_fail(err, HADA_ERROR_UNSUPPORTED,
                                  "PSFs that vary over the field are for planes that hide nothing: leave "
                                  "options.field_varying out, or options.occlude and options.surfaces")
                      : HADA_OK;
}

void hada_varying_destroy(hada_simulator *s)
{
    hada_varying *v = hada_taken(&s->varying);
    if (!v)
        return;
    for (int z = 0; z < s->camera.depths; z++) {
        if (v->psf)
            hada_image_destroy(&v->psf[z]);
        if (v->rays)
            free(v->rays[z]);
    }
    HADA_FREE(v->psf, v->rays, v->counts, v);
}

hada_status hada_varying_render(hada_simulator *s, const hada_plane *planes, int count, hada_image *raw,
                                hada_error *err)
{
    const hada_camera *camera = &s->camera;
    float value[3];
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_image_create(raw, camera->channels, camera->rows, camera->cols, err));
    for (int n = 0; n < count; n++) {
        const hada_image *image = planes[n].image;
        const size_t area = (size_t)image->rows * (size_t)image->cols;
        /* of the image's first pixel, from the axis */
        const int row0 = hada_window_origin(camera->rows, camera->window_rows) -
                         hada_window_origin(image->rows, camera->window_rows) - camera->rows / 2,
                  col0 = hada_window_origin(camera->cols, camera->window_cols) -
                         hada_window_origin(image->cols, camera->window_cols) - camera->cols / 2;
        HADA_TRY_OR_DONE(ready(s, planes[n].depth, err));
        for (int i = 0; i < image->rows; i++) {
            HADA_TRY_OR_DONE(hada_monitor_check(s->monitor, err));
            for (int j = 0; j < image->cols; j++) {
                float most = 0.0F;
                for (int c = 0; c < camera->channels; c++) {
                    value[c] = image->data[(image->channels > 1 ? (size_t)c * area : 0) +
                                           (size_t)i * (size_t)image->cols + (size_t)j];
                    most = fmaxf(most, fabsf(value[c]));
                }
                const point at = {row0 + i, col0 + j};
                if (most > 0.0F)
                    add_point(s, planes[n].depth, at, at, value, camera->channels, raw);
            }
        }
    }
done:
    if (status)
        hada_image_destroy(raw);
    return status;
}

hada_status hada_simulator_psf_at(const hada_simulator *s, int depth, int row, int col, hada_image *psf,
                                  hada_error *err)
{
    const float one[3] = {1.0F, 1.0F, 1.0F};
    const point at = {row, col};
    HADA_NEED(s && psf, err);
    *psf = (hada_image){0};
    HADA_TRY(hada_simulator_check_depth(s, depth, err));
    if (!s->varying)
        return hada_fail(err, HADA_ERROR_STATE, "PSFs of this simulator are the same everywhere: hada_simulator_psf()");
    HADA_TRY(ready(s, depth, err));
    HADA_TRY(hada_image_create(psf, s->varying->psf[depth].channels, s->camera.rows, s->camera.cols, err));
    add_point(s, depth, at, at, one, psf->channels, psf);
    return HADA_OK;
}
