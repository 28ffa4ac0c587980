#include "check_camera.h"

#include "ref/ref_fft.h"

static void fill_normal(const check_state *state, const check_camera *camera, size_t number, int is_frame, float *out)
{
    const hada_rectangle *frame = &camera->frame;
    check_fill_normal(state, number, out, (size_t)camera->rows * (size_t)camera->cols);
    for (int r = 0; r < camera->rows; r++)
        for (int c = 0; c < camera->cols; c++) {
            const int inside =
                r >= frame->row0 && r < frame->row0 + frame->rows && c >= frame->col0 && c < frame->col0 + frame->cols;
            out[r * camera->cols + c] *= !is_frame                   ? 1.0f / (float)camera->rows
                                         : camera->padded && !inside ? 0.0f
                                                                     : 1.0f;
        }
}

hada_status check_camera_make(check_state *state, check_camera *camera, hada_error *err)
{
    const int rows = camera->rows, cols = camera->cols;
    const hada_rectangle *frame = &camera->frame;
    const hada_spectrum_layout layout = hada_fft_layout(state->slot->context, rows, cols, HADA_FFT_AUTO);
    const size_t pixels = (size_t)rows * (size_t)cols, values = 2 * (size_t)rows * (size_t)(cols / 2 + 1);
    const size_t functions = camera->functions, images = functions + camera->channels, area = hada_rect_area(frame);
    float *drawn = check_room(state, pixels * sizeof *drawn);
    float *packed = check_room(state, images * layout.count * 2 * sizeof *packed);
    float *seen = check_room(state, camera->channels * area * sizeof *seen);
    double *grid = check_room(state, pixels * sizeof *grid), *spectrum = check_room(state, values * sizeof *spectrum);
    camera->half = check_room(state, images * values * sizeof *camera->half);
    camera->otfs = check_room(state, functions * values * sizeof *camera->otfs);
    camera->image = check_room(state, camera->channels * pixels * sizeof *camera->image);
    for (size_t k = 0; k < images; k++) {
        const int is_frame = k >= functions;
        double *image = is_frame ? camera->image + (k - functions) * pixels : grid;
        double *to = is_frame ? spectrum : camera->otfs + k * values;
        if (camera->fill)
            camera->fill(state, k, is_frame, drawn);
        else
            fill_normal(state, camera, k, is_frame, drawn);
        for (size_t i = 0; i < pixels; i++)
            image[i] = drawn[i];
        for (size_t i = 0; is_frame && i < area; i++)
            seen[(k - functions) * area + i] = drawn[((size_t)frame->row0 + i / (size_t)frame->cols) * (size_t)cols +
                                                     (size_t)frame->col0 + i % (size_t)frame->cols];
        HADA_TRY(hada_ref_fft_forward(image, rows, cols, to, err));
        for (size_t i = 0; i < values; i++)
            camera->half[k * values + i] = (float)to[i];
        hada_layout_pack(&layout, camera->half + k * values, packed + k * layout.count * 2);
    }
    HADA_TRY(check_upload(state, &camera->otf, packed, functions * layout.count * 8, err));
    HADA_TRY(check_upload(state, &camera->spectrum, packed + functions * layout.count * 2,
                          camera->channels * layout.count * 8, err));
    return check_upload(state, &camera->seen, seen, camera->channels * area * 4, err);
}

hada_status check_camera_weights(check_state *state, const check_camera *camera, hada_buffer *weights, double **of_grid,
                                 hada_error *err)
{
    const hada_rectangle *frame = &camera->frame;
    const size_t grid = (size_t)camera->rows * (size_t)camera->cols,
                 values = camera->channels * (size_t)frame->rows * (size_t)frame->cols;
    float *made = check_room(state, values * sizeof *made);
    *of_grid = check_room(state, camera->channels * grid * sizeof **of_grid);
    for (size_t c = 0, i = 0; c < camera->channels; c++)
        for (int row = 0; row < frame->rows; row++)
            for (int col = 0; col < frame->cols; col++, i++) {
                static const float kinds[] = {0.0f, 0.5f, 1.0f, 1.0f, -1.0f, 1.0f, -0.25f};
                made[i] = kinds[(i * 2654435761u >> 7) % HADA_COUNT(kinds)];
                (*of_grid)[c * grid + (size_t)(row + frame->row0) * (size_t)camera->cols +
                           (size_t)(col + frame->col0)] = (double)made[i];
            }
    return check_upload(state, weights, made, values * sizeof *made, err);
}
