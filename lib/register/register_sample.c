#include "register/register_inside.h"

#define PI 3.14159265358979323846

/* Means of 2 x 2; at odd sizes the last row and column are repeated. */
static void halve(const float *in, int rows, int cols, float *out)
{
    for (int r = 0; r < (rows + 1) / 2; r++)
        for (int c = 0; c < (cols + 1) / 2; c++) {
            const float *at = in + (size_t)(2 * r) * (size_t)cols + 2 * c;
            const size_t down = 2 * r + 1 < rows ? (size_t)cols : 0, right = 2 * c + 1 < cols ? 1 : 0;
            *out++ = 0.25f * (at[0] + at[right] + at[down] + at[down + right]);
        }
}

hada_status hada_register_plane_create(hada_register_plane *plane, const float *data, int rows, int cols,
                                       hada_error *err)
{
    *plane = (hada_register_plane){0};
    for (int k = 0; k < HADA_REGISTER_HALVINGS && (!k || rows > 4 || cols > 4); k++) {
        if (k) {
            rows = (rows + 1) / 2;
            cols = (cols + 1) / 2;
        }
        HADA_TRY(HADA_NEW_RAW(plane->data[k], (size_t)rows * (size_t)cols, "a copy", err));
        plane->rows[k] = rows;
        plane->cols[k] = cols;
        plane->levels = k + 1;
        if (k)
            halve(plane->data[k - 1], plane->rows[k - 1], plane->cols[k - 1], plane->data[k]);
        else
            memcpy(plane->data[0], data, (size_t)rows * (size_t)cols * sizeof(float));
    }
    return HADA_OK;
}

void hada_register_plane_destroy(hada_register_plane *plane)
{
    for (int k = 0; k < plane->levels; k++)
        free(plane->data[k]);
    *plane = (hada_register_plane){0};
}

/* Along one axis: `count` values, `stride` apart; nothing outside. */
static void smooth(const float *in, float *out, int count, size_t stride, const float *weight, int radius)
{
    for (int i = 0; i < count; i++) {
        const int first = i < radius ? -i : -radius, last = i + radius < count ? radius : count - 1 - i;
        float sum = 0.0f;
        for (int k = first; k <= last; k++)
            sum += weight[k + radius] * in[(size_t)(i + k) * stride];
        out[(size_t)i * stride] = sum;
    }
}

hada_status hada_register_view_create(hada_register_view *view, const hada_register_plane *plane, double step,
                                      hada_error *err)
{
    enum { RADIUS = 4 };
    float weight[2 * RADIUS + 1], sum = 0.0f;
    int k = 0;
    for (; step >= 2.0 && k + 1 < plane->levels; k++)
        step /= 2.0;
    const int rows = plane->rows[k], cols = plane->cols[k];
    *view = (hada_register_view){.rows = rows,
                                 .cols = cols,
                                 .scale = ldexp(1.0, -k),
                                 .mid_row = 0.5 * (plane->rows[0] - 1),
                                 .mid_col = 0.5 * (plane->cols[0] - 1),
                                 .data = plane->data[k]};
    if (step <= 1.0)
        return HADA_OK;
    const double sigma = 0.5 * sqrt(step * step - 1.0); /* continuous where halving or shrinking begins */
    for (int i = -RADIUS; i <= RADIUS; i++)
        sum += weight[i + RADIUS] = (float)exp(-0.5 * i * i / (sigma * sigma));
    for (int i = 0; i <= 2 * RADIUS; i++)
        weight[i] /= sum;
    const size_t count = (size_t)rows * (size_t)cols;
    HADA_TRY(HADA_NEW_RAW(view->room, 2 * count, "a smoothed copy", err));
    for (int r = 0; r < rows; r++)
        smooth(view->data + (size_t)r * (size_t)cols, view->room + count + (size_t)r * (size_t)cols, cols, 1, weight,
               RADIUS);
    for (int c = 0; c < cols; c++)
        smooth(view->room + count + c, view->room + c, rows, (size_t)cols, weight, RADIUS);
    view->data = view->room;
    return HADA_OK;
}

void hada_register_view_destroy(hada_register_view *view)
{
    free(view->room);
    *view = (hada_register_view){0};
}

void hada_register_matrix(const hada_registration *registration, double matrix[2][2])
{
    static const int cosines[4] = {1, 0, -1, 0}, sines[4] = {0, 1, 0, -1};
    const double angle = registration->rotation_deg * PI / 180.0, m = registration->magnification;
    const int k = registration->quarter_turns & 3;
    const double c = m * (cos(angle) * cosines[k] - sin(angle) * sines[k]);
    const double s = m * (sin(angle) * cosines[k] + cos(angle) * sines[k]);
    /* to the left with rows downwards: the column axis (0, 1) goes to (-sin, cos) */
    const double side = registration->mirrored ? -1.0 : 1.0;
    matrix[0][0] = c;
    matrix[0][1] = -s * side;
    matrix[1][0] = s;
    matrix[1][1] = c * side;
}

hada_register_map hada_register_map_of(const hada_registration *registration)
{
    double matrix[2][2];
    hada_register_matrix(registration, matrix);
    const double per = 1.0 / (matrix[0][0] * matrix[1][1] - matrix[0][1] * matrix[1][0]);
    return (hada_register_map){
        .inverse = {{per * matrix[1][1], -per * matrix[0][1]}, {-per * matrix[1][0], per * matrix[0][0]}},
        .perspective = {registration->perspective_row, registration->perspective_col},
        .offset = {registration->offset_row, registration->offset_col}};
}

static void cubic(double t, float weight[4])
{
    const double t2 = t * t, t3 = t2 * t;
    weight[0] = (float)(-0.5 * t3 + t2 - 0.5 * t);
    weight[1] = (float)(1.5 * t3 - 2.5 * t2 + 1.0);
    weight[2] = (float)(-1.5 * t3 + 2.0 * t2 + 0.5 * t);
    weight[3] = (float)(0.5 * t3 - 0.5 * t2);
}

static float interpolate(const hada_register_view *view, double u, double v)
{
    if (!(u > -2.0 && v > -2.0 && u < view->rows + 1.0 && v < view->cols + 1.0))
        return 0.0f;
    const int r = (int)floor(u) - 1, c = (int)floor(v) - 1;
    float down[4], right[4], sum = 0.0f;
    cubic(u - (r + 1), down);
    cubic(v - (c + 1), right);
    for (int i = 0; i < 4; i++) {
        if (r + i < 0 || r + i >= view->rows)
            continue;
        const float *line = view->data + (size_t)(r + i) * (size_t)view->cols;
        float here = 0.0f;
        for (int k = 0; k < 4; k++)
            if (c + k >= 0 && c + k < view->cols)
                here += right[k] * line[c + k];
        sum += down[i] * here;
    }
    return sum;
}

void hada_register_sample(const hada_register_view *view, const hada_register_map *map, double pitch, int rows,
                          int cols, float *out, int out_pitch, int out_step)
{
    /* the middle of the plane, in pixels of the view: exact also where halving rounded up */
    const double mid_row = (view->mid_row + 0.5) * view->scale - 0.5,
                 mid_col = (view->mid_col + 0.5) * view->scale - 0.5;
    const double row = map->offset[0] / pitch, col = map->offset[1] / pitch;
    for (int r = 0; r < rows; r++)
        for (int c = 0; c < cols; c++) {
            const double y = r - 0.5 * (rows - 1) - row, x = c - 0.5 * (cols - 1) - col;
            const double nearer = 1.0 - pitch * (map->perspective[0] * y + map->perspective[1] * x);
            const double to = view->scale * pitch / nearer;
            const double u = to * (map->inverse[0][0] * y + map->inverse[0][1] * x) + mid_row;
            const double v = to * (map->inverse[1][0] * y + map->inverse[1][1] * x) + mid_col;
            out[(size_t)r * (size_t)out_pitch + (size_t)(c * out_step)] =
                nearer > 0.0 ? interpolate(view, u, v) : 0.0f; /* else beyond the horizon */
        }
}
