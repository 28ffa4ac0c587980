/* Fused passes are run once against known answers before they are used: points of light through a camera that shifts
 * the picture, and back. Every pixel is compared, so that a wrong lane, block, row or twiddle factor shows. */
#include <math.h>
#include <stdlib.h>

#include "classic/classic_steps.h"
#include "core/base.h"

enum { POINTS = 24, SHIFT_ROWS = 1, SHIFT_COLS = 2 };
static const double allowed = 1e-5; /* of the points' root of the sum of squares */
static const char what[] = "the check of a classic method";

typedef struct trial {
    hada_classic *classic;
    hada_buffer otf;
    float *values, *planes, *frames;
    hada_classic_part start;           /* where the planes are */
    size_t plane_floats, frame_floats; /* of all planes, of all channels */
    double scale;
} trial;

static int round_edges(int at, int n)
{
    return at >= n ? at - n : at;
}

/* Transfer functions of the shift, the same for all channels. */
static void make_otf(trial *t)
{
    const hada_spectrum_layout *layout = &t->classic->layout;
    const double turn = 2.0 * acos(-1.0);
    for (int c = 0; c < t->classic->shape.place.channels; c++)
        for (int ky = 0; ky < layout->rows; ky++)
            for (int kx = 0; kx <= layout->cols / 2; kx++) {
                float *value = t->values + 2 * ((size_t)c * layout->count + hada_spectrum_index(layout, ky, kx));
                const double angle =
                    turn * ((double)ky * SHIFT_ROWS / layout->rows + (double)kx * SHIFT_COLS / layout->cols);
                value[0] = (float)cos(angle);
                value[1] = (float)-sin(angle);
            }
}

static void make_points(trial *t)
{
    const hada_classic_image *image = &t->classic->plane;
    unsigned seed = 1;
    double sum = 0.0;
    for (int p = 0; p < t->classic->planes; p++)
        for (int i = 0; i < POINTS; i++) {
            seed = seed * 1664525u + 1013904223u;
            const int row = i < 4 ? i / 2 * (image->rows - 1) : (int)(seed >> 8) % image->rows;
            seed = seed * 1664525u + 1013904223u;
            const int col = i < 4 ? i % 2 * (image->cols - 1) : (int)(seed >> 8) % image->cols;
            float *pixel = t->planes + (size_t)p * image->pixels + (size_t)row * (size_t)image->pitch + (size_t)col;
            *pixel += 0.25f * (float)(i % 4 + 1);
            sum += (double)*pixel * *pixel;
        }
    t->scale = sqrt(sum);
}

/* The largest difference between what the shift makes of the planes and the frames; or (back) of the frames and the
 * planes. */
static double compare(const trial *t, const float *planes, const float *frames, int back)
{
    const hada_classic *classic = t->classic;
    const hada_rectangle p = hada_classic_plane_rect(&classic->shape), f = hada_classic_frame_rect(&classic->shape);
    const int channels = classic->shape.place.channels, rows = classic->layout.rows, cols = classic->layout.cols;
    double largest = 0.0;
    for (int n = 0; n < (back ? classic->planes : channels); n++)
        for (int i = 0; i < (back ? p.rows : f.rows); i++)
            for (int j = 0; j < (back ? p.cols : f.cols); j++) {
                /* where this pixel of one stands in the other */
                const int row = back ? round_edges(p.row0 + i + SHIFT_ROWS, rows) - f.row0
                                     : round_edges(f.row0 + i + rows - SHIFT_ROWS % rows, rows) - p.row0;
                const int col = back ? round_edges(p.col0 + j + SHIFT_COLS, cols) - f.col0
                                     : round_edges(f.col0 + j + cols - SHIFT_COLS % cols, cols) - p.col0;
                const hada_rectangle *other = back ? &f : &p;
                const hada_classic_image *here = back ? &classic->plane : &classic->frame;
                const hada_classic_image *there = back ? &classic->frame : &classic->plane;
                double expected = 0.0;
                if (row >= 0 && row < other->rows && col >= 0 && col < other->cols)
                    for (int from = n % channels; from < (back ? n % channels + 1 : classic->planes); from += channels)
                        expected += (back ? frames : planes)[(size_t)from * there->pixels +
                                                             (size_t)row * (size_t)there->pitch + (size_t)col];
                const float value =
                    (back ? planes : frames)[(size_t)n * here->pixels + (size_t)i * (size_t)here->pitch + (size_t)j];
                if (!(fabs(value - expected) <= largest))
                    largest = isfinite(value) ? fabs(value - expected) : INFINITY;
            }
    return largest;
}

static hada_status run(trial *t, double *error, hada_error *err)
{
    hada_classic *classic = t->classic;
    const hada_classic_part from = t->start;
    hada_buffer *start = &classic->part[from];
    hada_buffer *prediction = &classic->part[HADA_CLASSIC_PREDICTION], *list = &classic->part[HADA_CLASSIC_LIST];
    const size_t plane_bytes = t->plane_floats * sizeof(float), frame_bytes = t->frame_floats * sizeof(float);
    const cl_int depths[2] = {0, 0};
    HADA_TRY(hada_buffer_write(start, classic->slot, 0, t->planes, plane_bytes, err));
    HADA_TRY(hada_buffer_write(list, classic->slot, 0, depths, (size_t)classic->job->depths * sizeof *depths, err));
    HADA_TRY(hada_classic_predict(classic, from, err));
    HADA_TRY(hada_classic_data_step(classic, HADA_CLASSIC_NO_STEP, 0.0, 1, err));
    HADA_TRY(hada_buffer_read(prediction, classic->slot, 0, t->frames, frame_bytes, err));
    *error = compare(t, t->planes, t->frames, 0);
    HADA_TRY(hada_classic_transpose(classic, from, err));
    HADA_TRY(hada_buffer_read(start, classic->slot, 0, t->planes, plane_bytes, err));
    *error = fmax(*error, compare(t, t->planes, t->frames, 1));
    return HADA_OK;
}

hada_status hada_classic_check(hada_classic *classic, hada_error *err)
{
    const size_t channels = (size_t)classic->shape.place.channels, otf = 2 * channels * classic->layout.count;
    /* components go through the passes as depths do: the check takes them for such */
    const int components = classic->shape.components, depths = classic->shape.place.max_planes * components > 1 ? 2 : 1;
    trial t = {.classic = classic,
               .start = components > 1 ? HADA_CLASSIC_COMPONENTS : HADA_CLASSIC_EXTRAPOLATED,
               .plane_floats = (size_t)depths * channels * classic->plane.pixels,
               .frame_floats = channels * classic->frame.pixels};
    hada_refine_data data = {.otf_depths = 1};
    const hada_classic_job job = {.data = &data, .depths = depths};
    double error = 0.0;
    hada_status status = HADA_OK;
    classic->job = &job;
    classic->shape.components = 1;
    classic->planes = depths * (int)channels;
    HADA_TRY_OR_DONE(HADA_NEW(t.values, otf, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(t.planes, t.plane_floats, what, err));
    HADA_TRY_OR_DONE(HADA_NEW(t.frames, t.frame_floats, what, err));
    if (!classic->slot->context->dry)
        make_otf(&t);
    HADA_TRY_OR_DONE(hada_buffer_create_from(&t.otf, classic->slot, t.values, otf * sizeof(float), what, err));
    if (classic->slot->context->dry)
        goto done;
    data.otf = t.otf.mem;
    make_points(&t);
    HADA_TRY_OR_DONE(run(&t, &error, err));
    if (!(error <= allowed * t.scale))
        HADA_TRY_OR_DONE(hada_fail(err, HADA_ERROR_SELF_TEST,
                                   "the fused transforms of %d x %d give wrong results on %s (error %.1e where %.0e is "
                                   "allowed): choose clFFT for them in the tuning file, or another device",
                                   classic->layout.rows, classic->layout.cols, classic->slot->context->info.name,
                                   error / t.scale, allowed));
done:
    classic->job = NULL;
    classic->shape.components = components;
    hada_slot_finish(classic->slot, NULL);
    hada_buffer_destroy(&t.otf);
    HADA_FREE(t.values, t.planes, t.frames);
    return status;
}
