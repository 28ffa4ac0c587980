#include "stress_camera.h"

#include "camera_small.h"
#include "model/model.h"
#include "ref/ref_filter.h"

stress_camera stress_camera_make(const stress_device *device, int rows, int cols, int depths, double lambda)
{
    static const double distances[] = {100.0, 200.0, 300.0, 400.0};
    stress_camera camera = {.rows = rows, .cols = cols, .depths = depths};
    DEFAULTS(hada_psf_options, options);
    options.boundary = HADA_BOUNDARY_CIRCULAR;
    options.window_rows = rows / 2 ? rows / 2 : 1;
    options.window_cols = cols / 2 ? cols / 2 : 1;
    options.psf_dark = 0.0;
    options.lambda = lambda;
    for (int z = 0; z < depths; z++)
        camera.psf[z] = small_psf(1, rows, cols, rows > 3 && cols > 3 ? 6 : 0, (uint64_t)z + 1);
    ASSERT_OK(hada_model_from_psf(&camera.model, device->context, camera.psf, depths, distances, &options, err));
    return camera;
}

void stress_camera_free(stress_camera *camera)
{
    destroy_images(camera->psf, camera->depths);
    hada_model_destroy(&camera->model);
}

void stress_camera_expose(const stress_camera *camera, hada_image *frame, uint64_t seed)
{
    const hada_model_info *info = hada_model_get_info(camera->model);
    SCOPED(hada_image) scene = small_scene(1, info->window_rows, info->window_cols, seed);
    SCOPED(hada_image) seen = small_frame(&camera->psf[0], &scene, 0, 0.01, seed);
    memcpy(frame->data, seen.data, hada_image_count(frame) * sizeof *frame->data);
}

double stress_camera_plane(const stress_camera *camera, const hada_image *frame, int depth, double *window,
                           double *whole)
{
    const hada_model_info *info = hada_model_get_info(camera->model);
    const size_t plane = hada_model_plane(camera->model);
    hada_geometry at;
    ASSERT_OK(hada_geometry_of(info, &at, err));
    hada_ref_grid grid = {info->grid_rows, info->grid_cols, at.raw_row,    at.raw_col,        info->raw_rows,
                          info->raw_cols,  at.window_row,   at.window_col, info->window_rows, info->window_cols};
    const float *filter = camera->model->filter + 2 * plane * (size_t)depth;
    double *spectrum = stress_memory(2 * plane, sizeof *spectrum), largest = 0.0;
    ASSERT_OK(hada_ref_grid_forward(&grid, frame->data, at.raw_row, at.raw_col, info->raw_rows, info->raw_cols,
                                    spectrum, err));
    ASSERT_OK(hada_ref_hadamard(&grid, spectrum, filter, 0, window, err));
    for (size_t i = 0; i < plane; i++)
        largest = fmax(largest, hypot(filter[2 * i], filter[2 * i + 1]));
    if (whole) {
        const size_t area = (size_t)info->grid_rows * (size_t)info->grid_cols;
        SCOPED_MEMORY double *image = stress_memory(area, sizeof *image);
        grid.window_row = grid.window_col = 0;
        grid.window_rows = grid.rows;
        grid.window_cols = grid.cols;
        ASSERT_OK(hada_ref_hadamard(&grid, spectrum, filter, 0, image, err));
        *whole = stress_norm_double(image, area);
    }
    free(spectrum);
    return largest;
}
