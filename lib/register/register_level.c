#include "image/mosaic.h"
#include "register/register_inside.h"

#define FADE  0.15 /* of the frame, at each edge: cut-off light must not make the edges stand out in the spectra */
#define RIDGE 0.1  /* of a ring's mean energy */

static double fade(int i, int count)
{
    const double from_edge = (i < count - 1 - i ? i : count - 1 - i) + 0.5;
    const double share = from_edge / (FADE * count);
    const double s = share < 1.0 ? sin(0.5 * 3.14159265358979323846 * share) : 1.0;
    return s * s;
}

static hada_status take_frame(hada_register_plane *plane, const float *data, int rows, int cols, hada_error *err)
{
    const size_t count = (size_t)rows * (size_t)cols;
    hada_status status = HADA_OK;
    float *faded;
    double mean = 0.0;
    HADA_TRY_OR_DONE(HADA_NEW_RAW(faded, count, "a frame", err));
    for (size_t i = 0; i < count; i++)
        mean += data[i] / (double)count;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            const size_t i = (size_t)r * (size_t)cols + (size_t)c;
            faded[i] = (float)((data[i] - mean) * fade(r, rows) * fade(c, cols));
        }
    HADA_TRY_OR_DONE(hada_register_plane_create(plane, faded, rows, cols, err));
done:
    free(faded);
    return status;
}

/* Standard deviation; 0 where only rounding makes values differ. */
static double deviation(const float *data, size_t count)
{
    double mean = 0.0, square = 0.0, largest = 0.0;
    for (size_t i = 0; i < count; i++) {
        mean += data[i] / (double)count;
        largest = fmax(largest, fabs(data[i]));
    }
    for (size_t i = 0; i < count; i++)
        square += (data[i] - mean) * (data[i] - mean) / (double)count;
    return sqrt(square) > 1e-6 * largest ? sqrt(square) : 0.0;
}

/* The channel with the most structure in frames and scenes; -1: there is none. */
static int choose_channel(const hada_image *raws, const hada_image *scenes, int count)
{
    const size_t frame = (size_t)raws->rows * (size_t)raws->cols, scene = (size_t)scenes->rows * (size_t)scenes->cols;
    int best = -1;
    double most = 0.0;
    for (int c = 0; c < raws->channels; c++) {
        double sum = 0.0;
        for (int i = 0; i < count; i++)
            sum += deviation(raws[i].data + (size_t)c * frame, frame) *
                   deviation(scenes[i].data + (size_t)c * scene, scene);
        if (sum > most) {
            most = sum;
            best = c;
        }
    }
    return best;
}

static hada_status check_pairs(const hada_image *raws, const hada_image *scenes, int count, hada_error *err)
{
    for (int i = 0; i < count; i++) {
        const hada_image *raw = &raws[i], *scene = &scenes[i];
        if (!raw->data || !scene->data)
            return hada_fail(err, HADA_ERROR_ARGUMENT, "pair %d lacks a frame or a scene", i + 1);
        if (raw->channels != raws->channels || raw->rows != raws->rows || raw->cols != raws->cols ||
            scene->channels != raws->channels || scene->rows != scenes->rows || scene->cols != scenes->cols)
            return hada_fail(err, HADA_ERROR_SIZE,
                             "pair %d: a frame of %d channels, %d x %d and a scene of %d channels, %d x %d do not go "
                             "with the first pair's %d channels, %d x %d and %d x %d%s",
                             i + 1, raw->channels, raw->rows, raw->cols, scene->channels, scene->rows, scene->cols,
                             raws->channels, raws->rows, raws->cols, scenes->rows, scenes->cols,
                             hada_mosaic_hint(raw->channels, scene->channels));
        const size_t bad = hada_image_count_not_finite(raw) + hada_image_count_not_finite(scene);
        if (bad)
            return hada_fail(err, HADA_ERROR_NOT_FINITE, "pair %d holds %zu NaN or infinite pixels", i + 1, bad);
    }
    const int side = raws->rows > raws->cols ? raws->rows : raws->cols;
    if (side < 32 || scenes->rows < 8 || scenes->cols < 8)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "frames of %d x %d and scenes of %d x %d are too small for registration; it needs 32 pixels "
                         "on a frame's longer side and scenes of 8 x 8",
                         raws->rows, raws->cols, scenes->rows, scenes->cols);
    return HADA_OK;
}

hada_status hada_register_set_create(hada_register_set *set, const hada_image *raws, const hada_image *scenes,
                                     int count, hada_error *err)
{
    *set = (hada_register_set){0};
    if (!raws || !scenes || count < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "registration needs pairs of a frame and a scene");
    if (count < 2)
        return hada_fail(
            err, HADA_ERROR_DATASET,
            "one pair does not show where scenes lie on the sensor: the PSF is unknown, so any transform explains "
            "it; give two or more, better five");
    count = count < HADA_REGISTER_PAIRS ? count : HADA_REGISTER_PAIRS;
    HADA_TRY(check_pairs(raws, scenes, count, err));
    const int channel = choose_channel(raws, scenes, count);
    if (channel < 0)
        HADA_TRY(
            hada_fail(err, HADA_ERROR_DATASET, "the frames or the scenes are flat: nothing in them can be registered"));
    set->frame_side = raws->rows > raws->cols ? raws->rows : raws->cols;
    for (int i = 0; i < count; i++) {
        const hada_image *raw = &raws[i], *scene = &scenes[i];
        set->count = i + 1;
        HADA_TRY(take_frame(&set->raws[i], raw->data + (size_t)channel * (size_t)raw->rows * (size_t)raw->cols,
                            raw->rows, raw->cols, err));
        HADA_TRY(hada_register_plane_create(&set->scenes[i],
                                            scene->data + (size_t)channel * (size_t)scene->rows * (size_t)scene->cols,
                                            scene->rows, scene->cols, err));
    }
    return HADA_OK;
}

void hada_register_set_destroy(hada_register_set *set)
{
    for (int i = 0; i < set->count; i++) {
        hada_register_plane_destroy(&set->raws[i]);
        hada_register_plane_destroy(&set->scenes[i]);
    }
    *set = (hada_register_set){0};
}

/* Spectra of planes, placed on the sensor, into level->x. Two real images make one complex transform. */
static hada_status transform(hada_register_level *level, const hada_register_plane *planes,
                             const hada_registration *placed, hada_error *err)
{
    const hada_register_map map = hada_register_map_of(placed);
    const int n = level->size, count = level->set->count;
    const double step =
        level->pitch * sqrt(fabs(map.inverse[0][0] * map.inverse[1][1] - map.inverse[0][1] * map.inverse[1][0]));
    for (int i = 0; i < count; i += 2) {
        memset(level->work, 0, 2 * (size_t)n * (size_t)n * sizeof(float));
        for (int k = i; k < count && k < i + 2; k++) {
            hada_register_view view;
            HADA_TRY(hada_register_view_create(&view, &planes[k], step, err));
            hada_register_sample(&view, &map, level->pitch, n, n, level->work + (k - i), 2 * n, 2);
            hada_register_view_destroy(&view);
        }
        hada_small_fft_run(&level->fft, level->work);
        for (int a = 0; a < n; a++)
            for (int b = 0; b < n; b++) {
                const float *z = level->work + 2 * ((size_t)a * (size_t)n + (size_t)b);
                const float *w = level->work + 2 * ((size_t)((n - a) % n) * (size_t)n + (size_t)((n - b) % n));
                float *x = level->x + 2 * (((size_t)a * (size_t)n + (size_t)b) * (size_t)count + (size_t)i);
                x[0] = 0.5f * (z[0] + w[0]);
                x[1] = 0.5f * (z[1] - w[1]);
                if (i + 1 < count) {
                    x[2] = 0.5f * (z[1] + w[1]);
                    x[3] = 0.5f * (w[0] - z[0]);
                }
            }
    }
    return HADA_OK;
}

/* What all pairs have in common (stray light, the structure of the PSF under bright scenes) would be explained by
 * scenes that are alike, as very small or large ones are: it is taken off where enough pairs are left. */
static int is_centred(const hada_register_level *level)
{
    return level->set->count >= 4;
}

static void centre(float *values, int count)
{
    float re = 0.0f, im = 0.0f;
    for (int i = 0; i < 2 * count; i += 2) {
        re += values[i] / (float)count;
        im += values[i + 1] / (float)count;
    }
    for (int i = 0; i < 2 * count; i += 2) {
        values[i] -= re;
        values[i + 1] -= im;
    }
}

static size_t place(const hada_register_level *level, int row, int col)
{
    const int mask = level->size - 1;
    return ((size_t)(col & mask) * (size_t)level->size + (size_t)(row & mask)) * 2 * (size_t)level->set->count;
}

static int ring_of(const hada_register_level *level, int row, int col)
{
    return (int)(sqrt((double)row * row + (double)col * col) * 2 * HADA_REGISTER_RINGS / level->size);
}

/* The frequencies of one half of the plane, between the lowest, where shading and the fading are, and the highest,
 * which the grid hardly holds. */
static hada_status list_bins(hada_register_level *level, hada_error *err)
{
    const int n = level->size, half = n / 2;
    HADA_TRY(HADA_NEW(level->at, 3 * (size_t)n * (size_t)(half + 1), "frequencies", err));
    for (int row = -half + 1; row < half; row++)
        for (int col = row > 0 ? 0 : 1; col < half; col++) {
            const int ring = ring_of(level, row, col);
            if (ring < 1 || ring >= HADA_REGISTER_RINGS - 1)
                continue;
            short *at = level->at + 3 * (size_t)level->bins++;
            at[0] = (short)row;
            at[1] = (short)col;
            at[2] = (short)ring;
            level->ring_bins[ring]++;
        }
    return HADA_OK;
}

static hada_status take_frames(hada_register_level *level, hada_error *err)
{
    const hada_registration as_it_is = {.magnification = 1.0};
    const size_t count = (size_t)level->set->count;
    const double others =
        is_centred(level) ? 1.0 - 1.0 / (double)count : 1.0; /* the mean leaves the pair out as well */
    HADA_TRY(transform(level, level->set->raws, &as_it_is, err));
    HADA_TRY(HADA_NEW_RAW(level->b, 2 * count * (size_t)level->bins, "spectra", err));
    for (int k = 0; k < level->bins; k++) {
        const short *at = level->at + 3 * k;
        float *b = level->b + 2 * count * (size_t)k;
        memcpy(b, level->x + place(level, at[0], at[1]), 2 * count * sizeof *b);
        if (is_centred(level))
            centre(b, (int)count);
        for (size_t i = 0; i < 2 * count; i++)
            level->frame_energy[at[2]] += (double)b[i] * b[i] / (others * others);
    }
    return HADA_OK;
}

hada_status hada_register_level_create(hada_register_level *level, const hada_register_set *set, int size,
                                       hada_error *err)
{
    const size_t area = (size_t)size * (size_t)size;
    *level = (hada_register_level){.set = set, .size = size, .pitch = (double)set->frame_side / size};
    HADA_TRY(hada_small_fft_create(&level->fft, size, err));
    HADA_TRY(HADA_NEW_RAW(level->work, 2 * area, "a transform", err));
    HADA_TRY(HADA_NEW_RAW(level->x, 2 * area * (size_t)set->count, "spectra", err));
    HADA_TRY(list_bins(level, err));
    return take_frames(level, err);
}

void hada_register_level_destroy(hada_register_level *level)
{
    hada_small_fft_destroy(&level->fft);
    HADA_FREE(level->at, level->b, level->x, level->work);
    *level = (hada_register_level){0};
}

hada_status hada_register_level_take(hada_register_level *level, const hada_registration *registration, hada_error *err)
{
    HADA_TRY(transform(level, level->set->scenes, registration, err));
    const size_t values = 2 * (size_t)level->set->count, area = (size_t)level->size * (size_t)level->size;
    for (size_t k = 0; is_centred(level) && k < area; k++)
        centre(level->x + values * k, level->set->count);
    memset(level->scene_energy, 0, sizeof level->scene_energy);
    for (int k = 0; k < level->bins; k++) {
        const short *at = level->at + 3 * k;
        const float *x = level->x + place(level, at[0], at[1]);
        for (size_t i = 0; i < values; i++)
            level->scene_energy[at[2]] += (double)x[i] * x[i];
    }
    return HADA_OK;
}

/* A frequency's squared leave-one-out errors, summed over the pairs. Ridge regression b = h x with all pairs has the
 * residuals r_i; without pair i its error is r_i / (others - |x_i|^2 / (sum |x|^2 + ridge)), where `others` is 1, or
 * 1 - 1 / count where b and x have their means taken off. */
static double left_out(const float *b, const float *x, int count, float ridge, float others)
{
    float energy = ridge, cross_re = 0.0f, cross_im = 0.0f, squares[HADA_REGISTER_PAIRS];
    double sum = 0.0;
    for (int i = 0; i < count; i++) {
        const float *p = x + 2 * i, *q = b + 2 * i;
        squares[i] = p[0] * p[0] + p[1] * p[1];
        energy += squares[i];
        cross_re += q[0] * p[0] + q[1] * p[1];
        cross_im += q[1] * p[0] - q[0] * p[1];
    }
    if (!(energy > 0.0f)) {
        for (int i = 0; i < 2 * count; i++)
            sum += b[i] * b[i] / (others * others);
        return sum;
    }
    const float per = 1.0f / energy, h_re = cross_re * per, h_im = cross_im * per;
    for (int i = 0; i < count; i++) {
        const float *p = x + 2 * i, *q = b + 2 * i;
        const float share = others - squares[i] * per;
        const float re = q[0] - (h_re * p[0] - h_im * p[1]), im = q[1] - (h_re * p[1] + h_im * p[0]);
        sum += (re * re + im * im) / (share * share);
    }
    return sum;
}

static void ridges(const hada_register_level *level, float ridge[HADA_REGISTER_RINGS])
{
    for (int ring = 0; ring < HADA_REGISTER_RINGS; ring++)
        ridge[ring] =
            level->ring_bins[ring] ? (float)(RIDGE * level->scene_energy[ring] / level->ring_bins[ring]) : 0.0f;
}

double hada_register_level_score(const hada_register_level *level, int quarter_turns, int mirrored)
{
    double turn[2][2], left[HADA_REGISTER_RINGS] = {0}, sum = 0.0;
    const hada_registration orientation = {.quarter_turns = quarter_turns, .mirrored = mirrored, .magnification = 1.0};
    hada_register_matrix(&orientation, turn);
    const int rr = (int)turn[0][0], rc = (int)turn[0][1], cr = (int)turn[1][0], cc = (int)turn[1][1];
    const int count = level->set->count;
    const float others = is_centred(level) ? 1.0f - 1.0f / (float)count : 1.0f;
    float ridge[HADA_REGISTER_RINGS];
    ridges(level, ridge);
    for (int k = 0; k < level->bins; k++) {
        const short *at = level->at + 3 * k;
        /* a turned image has a turned spectrum: the frequency that comes here; the same phase for all pairs aside */
        const int row = rr * at[0] + cr * at[1], col = rc * at[0] + cc * at[1];
        left[at[2]] += left_out(level->b + 2 * (size_t)count * (size_t)k, level->x + place(level, row, col), count,
                                ridge[at[2]], others);
    }
    for (int ring = 1; ring < HADA_REGISTER_RINGS - 1; ring++)
        if (left[ring] > 0.0 && left[ring] < level->frame_energy[ring])
            sum += level->ring_bins[ring] * log(left[ring] / level->frame_energy[ring]);
    return sum / level->bins;
}

void hada_register_level_psf(hada_register_level *level, float *psf)
{
    const int n = level->size, count = level->set->count, mask = n - 1;
    const float per_pixel = 1.0f / ((float)n * (float)n);
    float ridge[HADA_REGISTER_RINGS];
    ridges(level, ridge);
    memset(level->work, 0, 2 * (size_t)n * (size_t)n * sizeof(float));
    for (int k = 0; k < level->bins; k++) {
        const short *at = level->at + 3 * k;
        const float *b = level->b + 2 * (size_t)count * (size_t)k, *x = level->x + place(level, at[0], at[1]);
        float energy = ridge[at[2]], re = 0.0f, im = 0.0f;
        for (int i = 0; i < 2 * count; i += 2) {
            energy += x[i] * x[i] + x[i + 1] * x[i + 1];
            re += b[i] * x[i] + b[i + 1] * x[i + 1];
            im += b[i + 1] * x[i] - b[i] * x[i + 1];
        }
        if (!(energy > 0.0f))
            continue;
        /* a forward transform of the conjugate is the inverse one; the other half of the plane is conjugate */
        float *here = level->work + 2 * ((size_t)(at[1] & mask) * (size_t)n + (size_t)(at[0] & mask));
        float *there = level->work + 2 * ((size_t)(-at[1] & mask) * (size_t)n + (size_t)(-at[0] & mask));
        here[0] = there[0] = re / energy;
        here[1] = -im / energy;
        there[1] = im / energy;
    }
    hada_small_fft_run(&level->fft, level->work);
    for (int r = 1; r < n; r++)
        for (int c = 1; c < n; c++)
            *psf++ =
                per_pixel * level->work[2 * ((size_t)((r - n / 2) & mask) * (size_t)n + (size_t)((c - n / 2) & mask))];
}
