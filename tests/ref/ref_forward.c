#include "ref/ref_forward.h"

#include <math.h>

#include "optics/mask.h"

static double pixel(const float *image, int rows, int cols, int r, int c)
{
    return r >= 0 && r < rows && c >= 0 && c < cols ? image[(size_t)r * (size_t)cols + (size_t)c] : 0.0;
}

double hada_ref_opacity(const float *opacity, int rows, int cols, double row, double col)
{
    const int r = (int)floor(row), c = (int)floor(col);
    const double v = row - r, u = col - c;
    return (1.0 - v) * ((1.0 - u) * pixel(opacity, rows, cols, r, c) + u * pixel(opacity, rows, cols, r, c + 1)) +
           v * ((1.0 - u) * pixel(opacity, rows, cols, r + 1, c) + u * pixel(opacity, rows, cols, r + 1, c + 1));
}

void hada_ref_hide(const double *light, const float *opacity, int channels, int rows, int cols, const float *weight,
                   int row0, int col0, int tap_rows, int tap_cols, double *seen)
{
    for (int c = 0; c < channels; c++)
        for (int r = 0; r < rows; r++)
            for (int k = 0; k < cols; k++) {
                double cover = 0.0;
                for (int i = 0; i < tap_rows; i++)
                    for (int j = 0; j < tap_cols; j++)
                        cover += weight[i * tap_cols + j] * pixel(opacity, rows, cols, r + row0 + i, k + col0 + j);
                *seen++ = *light++ * fmax(0.0, 1.0 - cover);
            }
}

double hada_ref_clear(const hada_camera *camera, const float *opacity, int rows, int cols, double near_mm,
                      double far_mm, double x, double y, int half, int row, int col)
{
    const double d = camera->distance_mm, pitch = camera->pixel_pitch_mm, radius = camera->lens_diameter_mm / 2.0,
                 step = radius / (half + 0.5), axis_row = rows / 2, axis_col = cols / 2;
    const double far_x = -(col - axis_col) * pitch * far_mm / d, far_y = -(row - axis_row) * pitch * far_mm / d;
    double covered = 0.0;
    int points = 0;
    for (int i = -half; i <= half; i++)
        for (int j = -half; j <= half; j++) {
            const double qx = x + j * step, qy = y + i * step;
            if (hypot(j * step, i * step) > radius)
                continue;
            const double near_x = qx + (far_x - qx) * near_mm / far_mm, near_y = qy + (far_y - qy) * near_mm / far_mm;
            covered += hada_ref_opacity(opacity, rows, cols, axis_row - near_y * d / (near_mm * pitch),
                                        axis_col - near_x * d / (near_mm * pitch));
            points++;
        }
    return 1.0 - covered / points;
}

int hada_ref_nearest_spot(const hada_camera *camera, const double *x, const double *y, double distance_mm, double at_x,
                          double at_y)
{
    const double m = hada_camera_magnification(camera, distance_mm);
    int best = 0;
    for (int i = 1; i < camera->lenses; i++)
        if (hypot(x[i] * m - at_x, y[i] * m - at_y) < hypot(x[best] * m - at_x, y[best] * m - at_y))
            best = i;
    return best;
}
