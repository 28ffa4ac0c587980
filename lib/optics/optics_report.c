/* What a camera resolves, by its design and by its point spread functions. */
#include <hadalens/optics.h>

#include "core/callers.h"
#include "fft/fft.h"
#include "optics/mask.h"

/* Modulation transfer and self-correlation of PSFs, on the device. */
typedef struct hada_mtf {
    hada_slot *slot;
    hada_fft *forward, *inverse;
    hada_spectrum_layout layout; /* of a grid twice the image: correlations do not wrap round */
    hada_buffer real, spectrum;
    float *values; /* a spectrum, or an image, on the host */
    int rows, cols;
} hada_mtf;

static hada_status mtf_create(hada_mtf *mtf, hada_context *context, int rows, int cols, hada_error *err)
{
    *mtf = (hada_mtf){.rows = rows, .cols = cols};
    const int grid_rows = hada_fft_good_size(2 * rows), grid_cols = hada_fft_good_size(2 * cols);
    const hada_fft_desc desc =
        hada_fft_of(HADA_FFT_FORWARD, grid_rows, grid_cols, 1, (hada_rectangle){0, 0, rows, cols});
    const hada_fft_desc back = hada_fft_whole(HADA_FFT_INVERSE, grid_rows, grid_cols, 1);
    HADA_TRY(hada_slot_create(&mtf->slot, context, err));
    HADA_TRY(hada_fft_create(&mtf->forward, mtf->slot, &desc, err));
    HADA_TRY(hada_fft_create(&mtf->inverse, mtf->slot, &back, err));
    mtf->layout = *hada_fft_plan_layout(mtf->forward);
    const size_t spectrum = 2 * mtf->layout.count;
    const size_t floats = spectrum > back.real_distance ? spectrum : back.real_distance;
    HADA_TRY(HADA_NEW(mtf->values, floats, "a spectrum", err));
    HADA_TRY(hada_buffer_create(&mtf->real, context, back.real_distance * sizeof(float), "an image", err));
    return hada_buffer_create(&mtf->spectrum, context, spectrum * sizeof(float), "a spectrum", err);
}

static void mtf_destroy(hada_mtf *mtf)
{
    if (mtf->slot)
        hada_slot_finish(mtf->slot, NULL);
    hada_fft_destroy(&mtf->forward);
    hada_fft_destroy(&mtf->inverse);
    HADA_DESTROY_BUFFERS(&mtf->real, &mtf->spectrum);
    hada_slot_destroy(&mtf->slot);
    free(mtf->values);
    *mtf = (hada_mtf){0};
}

/* Every frequency once: those of the half spectrum that have a mirror image count twice. */
static double rings_of(hada_mtf *mtf, double threshold, int rings, double *mean, double *weight)
{
    const int rows = mtf->layout.rows, cols = mtf->layout.cols;
    const double whole = hypot(mtf->values[0], mtf->values[1]);
    double reached = 0.0;
    for (int i = 0; i < rings; i++)
        mean[i] = weight[i] = 0.0;
    for (int ky = 0; ky < rows; ky++)
        for (int kx = 0; kx <= cols / 2; kx++) {
            float *at = mtf->values + 2 * hada_spectrum_index(&mtf->layout, ky, kx);
            const double square = (double)at[0] * at[0] + (double)at[1] * at[1], gain = sqrt(square) / whole;
            const double fy = (double)(ky <= rows / 2 ? ky : ky - rows) / rows, fx = (double)kx / cols;
            const double count = kx && 2 * kx != cols ? 2.0 : 1.0;
            const int ring = (int)(2.0 * rings * sqrt(fx * fx + fy * fy));
            if (ring < rings) {
                mean[ring] += count * gain;
                weight[ring] += count;
            }
            reached += gain >= threshold ? count : 0.0;
            at[0] = (float)square;
            at[1] = 0.0f;
        }
    for (int i = 0; i < rings; i++)
        mean[i] = weight[i] > 0.0 ? mean[i] / weight[i] : NAN;
    return reached / ((double)rows * cols);
}

/* Of an image of one channel: means of the MTF over `rings` rings up to 0.5 cycles per pixel, and the share of the
 * frequencies, corners too, where it reaches a threshold. The self-correlation is kept in *mtf. */
static hada_status mtf_measure(hada_mtf *mtf, const hada_image *image, double threshold, int rings, double *mean,
                               double *support, hada_error *err)
{
    const size_t pixels = (size_t)mtf->rows * (size_t)mtf->cols * sizeof(float);
    const size_t spectrum = 2 * mtf->layout.count * sizeof(float);
    const size_t grid = (size_t)mtf->layout.rows * (size_t)mtf->layout.cols * sizeof(float);
    double *weight = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(weight, (size_t)rings, "rings", err));
    HADA_TRY_OR_DONE(hada_buffer_write(&mtf->real, mtf->slot, 0, image->data, pixels, err));
    HADA_TRY_OR_DONE(hada_fft_forward(mtf->forward, 1, mtf->real.mem, 0, mtf->spectrum.mem, 0, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&mtf->spectrum, mtf->slot, 0, mtf->values, spectrum, err));
    *support = rings_of(mtf, threshold, rings, mean, weight);
    HADA_TRY_OR_DONE(hada_buffer_write(&mtf->spectrum, mtf->slot, 0, mtf->values, spectrum, err));
    HADA_TRY_OR_DONE(hada_fft_inverse(mtf->inverse, 1, mtf->spectrum.mem, 0, mtf->real.mem, 0, NULL, err));
    HADA_TRY_OR_DONE(hada_buffer_read(&mtf->real, mtf->slot, 0, mtf->values, grid, err));
done:
    free(weight);
    return status;
}

/* The self-correlation at a lag, |row| < rows, |col| < cols, relative to lag 0. */
static double mtf_self(const hada_mtf *mtf, int row, int col)
{
    const int rows = mtf->layout.rows, cols = mtf->layout.cols;
    const size_t at = (size_t)((row + rows) % rows) * (size_t)cols + (size_t)((col + cols) % cols);
    return (double)mtf->values[at] / mtf->values[0];
}

/* What a camera resolves: its PSFs, one after the other, become rows of tables. */

#define RINGS 256

struct hada_optics_report {
    hada_optics_curves curves; /* as they are shown */
    hada_optics_row *row;      /* by depth */
    double *mtf, *self, *correlation;
    hada_camera camera;
    hada_mtf measure;
    int done;
    hada_image *mean; /* of the channels of each PSF so far */
    double *norm;
};

static hada_status reserve(hada_optics_report *report, hada_error *err)
{
    const size_t depths = (size_t)report->curves.depths;
    HADA_TRY(HADA_NEW(report->row, depths, "a report", err));
    HADA_TRY(HADA_NEW(report->mtf, depths * RINGS, "a report", err));
    HADA_TRY(HADA_NEW(report->self, depths * (size_t)report->curves.lags, "a report", err));
    HADA_TRY(HADA_NEW(report->correlation, depths * depths, "a report", err));
    HADA_TRY(HADA_NEW(report->mean, depths, "a report", err));
    HADA_TRY(HADA_NEW(report->norm, depths, "a report", err));
    report->curves.mtf = report->mtf;
    report->curves.self = report->self;
    report->curves.correlation = report->correlation;
    return HADA_OK;
}

hada_status hada_optics_report_create(hada_optics_report **out, hada_context *context, const hada_camera *callers,
                                      double threshold, hada_error *err)
{
    HADA_NEED(out && context && callers, err);
    hada_camera camera;
    hada_optics_report *report = NULL;
    hada_status status = HADA_OK;
    *out = NULL;
    HADA_TRY_OR_DONE(hada_camera_take(&camera, callers, err));
    HADA_TRY_OR_DONE(HADA_NEW(report, 1, "a report", err));
    const int lags = (camera.rows < camera.cols ? camera.rows : camera.cols) / 2;
    report->camera = camera;
    report->curves = (hada_optics_curves){.depths = camera.depths,
                                          .frequencies = RINGS,
                                          .lags = lags > 0 ? lags : 1,
                                          .threshold = threshold == HADA_AUTO ? 0.05 : threshold};
    HADA_TRY_OR_DONE(reserve(report, err));
    HADA_TRY_OR_DONE(mtf_create(&report->measure, context, camera.rows, camera.cols, err));
    *out = report;
    report = NULL;
done:
    hada_optics_report_destroy(&report);
    return status;
}

void hada_optics_report_destroy(hada_optics_report **pointer)
{
    hada_optics_report *report = hada_taken(pointer);
    if (!report)
        return;
    for (int z = 0; report->mean && z < report->curves.depths; z++)
        hada_image_destroy(&report->mean[z]);
    HADA_FREE(report->mean, report->norm);
    mtf_destroy(&report->measure);
    HADA_FREE(report->row, report->mtf, report->self, report->correlation, report);
}

const hada_optics_curves *hada_optics_report_curves(const hada_optics_report *report)
{
    return report ? &report->curves : NULL;
}

const hada_optics_row *hada_optics_report_row(const hada_optics_report *report, int depth)
{
    return report ? &report->row[depth] : NULL;
}

static hada_status mean_of_channels(hada_image *mean, const hada_image *psf, hada_error *err)
{
    const size_t count = (size_t)psf->rows * (size_t)psf->cols;
    HADA_TRY(hada_image_create(mean, 1, psf->rows, psf->cols, err));
    for (size_t i = 0; i < count; i++) {
        double sum = 0.0;
        for (int c = 0; c < psf->channels; c++)
            sum += psf->data[(size_t)c * count + i];
        mean->data[i] = (float)(sum / psf->channels);
    }
    return HADA_OK;
}

/* Closed forms. */
static void fill_design(const hada_camera *c, double distance, hada_optics_row *row)
{
    const double green = c->wavelengths_nm[1] * 1e-6, pitch = c->pixel_pitch_mm, d = c->distance_mm;
    hada_camera in_green = *c;
    in_green.focal_length_mm = hada_camera_focal_length(c, c->wavelengths_nm[1]);
    const int cells = c->mask == HADA_MASK_APERTURE && c->cell_mm > 0.0, diffuser = c->mask == HADA_MASK_DIFFUSER;
    const double width = cells ? c->cell_mm : c->lens_diameter_mm;
    const double shrink = c->distances_mm[0] / distance; /* M / (M at the nearest distance) */
    *row = (hada_optics_row){.distance_mm = distance, .magnification = hada_camera_magnification(c, distance)};
    row->defocus_pixels = diffuser ? NAN : hada_camera_defocus_pixels(&in_green, distance);
    row->airy_pixels = diffuser ? NAN : 1.21967 * green * d / (width * pitch);
    row->object_pixel_mm = pitch * distance / d;
    row->occupancy = NAN;
    if (hada_mask_has_lenses(c))
        row->occupancy =
            c->lenses * ((double)c->window_rows * c->window_cols) / ((double)c->rows * c->cols) * shrink * shrink;
}

/* The largest self-correlation at each distance in pixels, rounded. */
static void fill_self(const hada_mtf *mtf, int lags, double *self)
{
    for (int i = 0; i < lags; i++)
        self[i] = 0.0;
    for (int r = 0; r < lags; r++) /* the other half is the same, turned round */
        for (int c = -lags + 1; c < lags; c++) {
            const int lag = (int)lrint(sqrt((double)r * r + (double)c * c));
            if (lag < lags)
                self[lag] = fmax(self[lag], mtf_self(mtf, r, c));
        }
}

/* Full width at half maximum of the peak: of the circle whose area is that of the places above one half about lag 0,
 * found along 64 rays. */
static double peak_width(const hada_mtf *mtf, int lags)
{
    enum { RAYS = 64 };
    double squares = 0.0;
    for (int i = 0; i < RAYS; i++) {
        const double y = sin(3.14159265358979 * i / RAYS), x = cos(3.14159265358979 * i / RAYS);
        double before = 1.0, at = 0.0;
        for (double step = 0.0625, away = step; away < lags - 2; away += step) {
            const double row = y * away, col = x * away, r = floor(row), c = floor(col), u = row - r, v = col - c;
            const int i0 = (int)r, j0 = (int)c;
            const double here = (1 - u) * ((1 - v) * mtf_self(mtf, i0, j0) + v * mtf_self(mtf, i0, j0 + 1)) +
                                u * ((1 - v) * mtf_self(mtf, i0 + 1, j0) + v * mtf_self(mtf, i0 + 1, j0 + 1));
            at = away;
            if (here < 0.5) {
                at = away - step * (0.5 - here) / (before - here);
                break;
            }
            before = here;
        }
        squares += at * at;
    }
    return 2.0 * sqrt(squares / RAYS);
}

static void fill_measured(hada_optics_report *report, int z, double support)
{
    const hada_camera *c = &report->camera;
    hada_optics_row *row = &report->row[z];
    double *self = report->self + (size_t)z * (size_t)report->curves.lags;
    const double *mtf = report->mtf + (size_t)z * RINGS;
    fill_self(&report->measure, report->curves.lags, self);
    const double width = peak_width(&report->measure, report->curves.lags);
    row->spot_pixels = width / sqrt(2.0);
    row->support = support;
    for (int i = 0; i < RINGS; i++)
        if (mtf[i] >= report->curves.threshold)
            row->cutoff = (i + 1) / (2.0 * RINGS);
    for (int lag = (int)ceil(2.0 * width); lag < report->curves.lags; lag++)
        row->sidelobe = fmax(row->sidelobe, self[lag]);
    row->lateral_mm = row->spot_pixels * row->object_pixel_mm;
    row->axial_design_mm = row->distance_mm * row->distance_mm * row->spot_pixels * c->pixel_pitch_mm /
                           (c->distance_mm * c->aperture_mm / 2.0);
    row->axial_mm = NAN;
}

/* Where the correlation of depth z with those on one side falls to a half: the step of the distance. NaN where it does
 * not. */
static double axial(const hada_optics_report *report, int z, int side)
{
    const double near = 1.0 / report->row[z].distance_mm;
    for (int i = z + side; i >= 0 && i < report->curves.depths; i += side) {
        const double *line = report->correlation + (size_t)z * (size_t)report->curves.depths;
        if (line[i] >= 0.5)
            continue;
        const double from = 1.0 / report->row[i - side].distance_mm, to = 1.0 / report->row[i].distance_mm;
        const double inverse = from + (to - from) * (line[i - side] - 0.5) / (line[i - side] - line[i]);
        return fabs(1.0 / inverse - 1.0 / near);
    }
    return NAN;
}

hada_status hada_optics_report_add(hada_optics_report *report, const hada_image *psf, hada_error *err)
{
    HADA_NEED(report, err);
    HADA_NEED_IMAGE(psf, NULL, err);
    const hada_camera *c = &report->camera;
    const int z = report->done;
    double support = 0.0;
    if (z >= report->curves.depths)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "the report has all %d depths of the camera already", z);
    if (psf->rows != c->rows || psf->cols != c->cols || psf->channels < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a PSF of %d x %d does not fit a camera of %d x %d", psf->rows,
                         psf->cols, c->rows, c->cols);
    if (hada_image_count_not_finite(psf))
        return hada_fail(err, HADA_ERROR_NOT_FINITE, "PSF %d holds NaN or infinite values", z + 1);
    hada_image_destroy(&report->mean[z]); /* of an earlier try */
    HADA_TRY(mean_of_channels(&report->mean[z], psf, err));
    report->norm[z] =
        sqrt(hada_product(report->mean[z].data, report->mean[z].data, hada_image_count(&report->mean[z])));
    fill_design(c, c->distances_mm[z], &report->row[z]);
    for (size_t i = 0; i < hada_image_count(&report->mean[z]); i++)
        report->row[z].light += report->mean[z].data[i];
    if (!(report->norm[z] > 0.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "PSF %d is dark", z + 1);
    HADA_TRY(mtf_measure(&report->measure, &report->mean[z], report->curves.threshold, RINGS,
                         report->mtf + (size_t)z * RINGS, &support, err));
    fill_measured(report, z, support);
    const size_t depths = (size_t)report->curves.depths;
    for (int i = 0; i <= z; i++) {
        const double value =
            hada_product(report->mean[i].data, report->mean[z].data, hada_image_count(&report->mean[i])) /
            (report->norm[i] * report->norm[z]);
        report->correlation[(size_t)i * depths + (size_t)z] = report->correlation[(size_t)z * depths + (size_t)i] =
            value;
    }
    if (++report->done < report->curves.depths)
        return HADA_OK;
    for (int i = 0; i < report->curves.depths; i++)
        report->row[i].axial_mm = axial(report, i, i + 1 < report->curves.depths ? 1 : -1);
    mtf_destroy(&report->measure); /* the device has done its part */
    return HADA_OK;
}
