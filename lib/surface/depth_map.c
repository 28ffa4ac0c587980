#include "surface/level.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/base.h"

static const char what[] = "a depth map";

/* A Gaussian is cut off so many standard deviations from its middle. */
#define REACH 4.0
/* Light, as a part of the mean over pixels, that is added to every pixel, evenly over its planes: where there is none,
 * a depth is as good as another. */
#define FAINT 1e-6
/* A pixel at a jump is wrong by about twice the rms bend of the map round it, over so many pixels on each side. */
#define BEND 2.0
enum { BEND_RADIUS = 3 };
/* Steps of the primal-dual iteration; their product with the square of the gradient's norm, 8, is below 1. */
#define STEP 0.35

static size_t area_of(hada_map_size size)
{
    return (size_t)size.rows * (size_t)size.cols;
}

/* Weights of a Gaussian at 0, 1, ... radius, their sum over both sides 1. */
static hada_status gaussian(double blur, double **out, int *radius, hada_error *err)
{
    double sum = 0.0;
    *radius = blur > 0.0 ? (int)ceil(REACH * blur) : 0;
    HADA_TRY(HADA_NEW(*out, (size_t)*radius + 1, what, err));
    for (int i = 0; i <= *radius; i++) {
        (*out)[i] = i ? exp(-0.5 * i * i / (blur * blur)) : 1.0;
        sum += i ? 2.0 * (*out)[i] : 1.0;
    }
    for (int i = 0; i <= *radius; i++)
        (*out)[i] /= sum;
    return HADA_OK;
}

/* One line, pixels `step` apart; beyond its ends it goes on as there. */
static void blur_line(const double *weight, int radius, int n, size_t step, const double *in, double *out)
{
    for (int i = 0; i < n; i++) {
        double sum = weight[0] * in[(size_t)i * step];
        for (int k = 1; k <= radius; k++)
            sum += weight[k] * (in[(size_t)hada_within(i - k, n) * step] + in[(size_t)hada_within(i + k, n) * step]);
        out[(size_t)i * step] = sum;
    }
}

static void blur_image(const double *weight, int radius, hada_map_size size, double *image, double *work)
{
    for (int y = 0; y < size.rows; y++)
        blur_line(weight, radius, size.cols, 1, image + (size_t)y * (size_t)size.cols,
                  work + (size_t)y * (size_t)size.cols);
    for (int x = 0; x < size.cols; x++)
        blur_line(weight, radius, size.rows, (size_t)size.cols, work + x, image + x);
}

hada_status hada_map_centre(const float *light, int planes, int channels, hada_map_size size, double blur, float *depth,
                            float *sum, hada_error *err)
{
    const size_t area = area_of(size);
    double *memory = NULL, *weight = NULL, mean = 0.0;
    int radius = 0;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(memory, 4 * area, what, err));
    HADA_TRY_OR_DONE(gaussian(blur, &weight, &radius, err));
    double *plane = memory, *work = memory + area, *all = memory + 2 * area, *moment = memory + 3 * area;
    for (size_t k = 0; k < (size_t)planes; k++) {
        memset(plane, 0, area * sizeof *plane);
        for (size_t c = 0; c < (size_t)channels; c++)
            for (size_t i = 0; i < area; i++)
                plane[i] += light[(k * (size_t)channels + c) * area + i];
        blur_image(weight, radius, size, plane, work);
        for (size_t i = 0; i < area; i++) {
            all[i] += plane[i];
            moment[i] += (double)k * plane[i];
        }
    }
    for (size_t i = 0; i < area; i++)
        mean += all[i] / (double)area;
    const double faint = mean > 0.0 ? FAINT * mean : 1.0;
    for (size_t i = 0; i < area; i++) {
        depth[i] = (float)((moment[i] + faint * (planes - 1) / 2.0) / (all[i] + faint));
        sum[i] = (float)all[i];
    }
done:
    HADA_FREE(weight, memory);
    return status;
}

/* The least or, sign -1, the most of the 3 x 3 pixels round each. */
static void extreme(const float *in, hada_map_size size, float sign, float *out)
{
    for (int y = 0; y < size.rows; y++)
        for (int x = 0; x < size.cols; x++) {
            float least = INFINITY;
            for (int i = hada_within(y - 1, size.rows); i <= hada_within(y + 1, size.rows); i++)
                for (int j = hada_within(x - 1, size.cols); j <= hada_within(x + 1, size.cols); j++)
                    least = fminf(least, sign * in[(size_t)i * (size_t)size.cols + (size_t)j]);
            out[(size_t)y * (size_t)size.cols + (size_t)x] = sign * least;
        }
}

hada_status hada_map_band(const float *depth, hada_map_size from, double scale, double margin, int planes,
                          hada_map_size to, const hada_map_place *place, float *allowed, hada_error *err)
{
    const size_t area = area_of(to);
    float *low = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(low, 2 * area_of(from), what, err));
    float *high = low + area_of(from);
    extreme(depth, from, 1.0F, low);
    extreme(depth, from, -1.0F, high);
    memset(allowed, 0, (size_t)planes * area * sizeof *allowed);
    for (int y = 0; y < to.rows; y++)
        for (int x = 0; x < to.cols; x++) {
            const size_t row = (size_t)hada_within((int)lround(place->row + y * place->down), from.rows);
            const size_t at =
                row * (size_t)from.cols + (size_t)hada_within((int)lround(place->col + x * place->along), from.cols);
            const int first = hada_within((int)floor(scale * (low[at] - margin)), planes);
            const int last = hada_within((int)ceil(scale * (high[at] + margin)), planes);
            for (int k = first; k <= last; k++)
                allowed[(size_t)k * area + (size_t)y * (size_t)to.cols + (size_t)x] = 1.0F;
        }
done:
    free(low);
    return status;
}

/* The pixel at or before a place, and how far behind it the place is. */
static int split(double at, int n, double *part)
{
    const double inside = at < 0.0 ? 0.0 : at > n - 1 ? n - 1 : at;
    const int low = n > 1 ? hada_within((int)inside, n - 1) : 0;
    *part = inside - low;
    return low;
}

void hada_map_resample(const float *in, hada_map_size from, float *out, hada_map_size to, const hada_map_place *place)
{
    const size_t right = from.cols > 1, down = from.rows > 1 ? (size_t)from.cols : 0;
    for (int y = 0; y < to.rows; y++) {
        double b;
        const float *line = in + (size_t)split(place->row + y * place->down, from.rows, &b) * (size_t)from.cols;
        for (int x = 0; x < to.cols; x++) {
            double a;
            const float *p = line + split(place->col + x * place->along, from.cols, &a);
            out[(size_t)y * (size_t)to.cols + (size_t)x] = (float)((1.0 - b) * ((1.0 - a) * p[0] + a * p[right]) +
                                                                   b * ((1.0 - a) * p[down] + a * p[down + right]));
        }
    }
}

/* The depth below and above which half of the light stands; the depths are put in order. */
static float weighted_median(float *depth, float *light, int count)
{
    double all = 0.0, sum = 0.0;
    for (int i = 0; i < count; i++)
        all += light[i];
    for (int i = 1; i < count; i++)
        for (int k = i; k > 0 && depth[k] < depth[k - 1]; k--) {
            const float d = depth[k], l = light[k];
            depth[k] = depth[k - 1];
            light[k] = light[k - 1];
            depth[k - 1] = d;
            light[k - 1] = l;
        }
    for (int i = 0; i < count; i++) {
        sum += light[i];
        if (sum >= all / 2.0)
            return depth[i];
    }
    return depth[count - 1];
}

hada_status hada_map_sharpen(float *depth, const float *light, hada_map_size size, double jump, hada_error *err)
{
    const size_t area = area_of(size);
    float *given = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(given, area, what, err));
    memcpy(given, depth, area * sizeof *given);
    for (int y = 0; y < size.rows; y++)
        for (int x = 0; x < size.cols; x++) {
            float near[9], weight[9], least = INFINITY, most = -INFINITY;
            int count = 0;
            for (int i = hada_within(y - 1, size.rows); i <= hada_within(y + 1, size.rows); i++)
                for (int j = hada_within(x - 1, size.cols); j <= hada_within(x + 1, size.cols); j++) {
                    const size_t at = (size_t)i * (size_t)size.cols + (size_t)j;
                    near[count] = given[at];
                    weight[count++] = light[at];
                    least = fminf(least, given[at]);
                    most = fmaxf(most, given[at]);
                }
            if (most - least > jump)
                depth[(size_t)y * (size_t)size.cols + (size_t)x] = weighted_median(near, weight, count);
        }
done:
    free(given);
    return status;
}

void hada_map_rule_init(hada_map_rule *rule)
{
    /* of a trial on slants, hills, balls and stairs: weak, which little depends on (docs/explanation/surfaces.md) */
    *rule = (hada_map_rule){.weight = 0.05, .data = 1.2, .tolerance = 0.4, .steps = 60};
}

/* The sum over channels of the squared differences to the pixels below and to the right, 0 at the far edges. */
static void gradient_squares(const float *texture, int channels, hada_map_size size, double *out)
{
    const size_t area = area_of(size), cols = (size_t)size.cols;
    memset(out, 0, area * sizeof *out);
    for (size_t c = 0; c < (size_t)channels; c++)
        for (size_t i = 0; i < area; i++) {
            const float *t = texture + c * area + i;
            const double below = i + cols < area ? t[cols] - t[0] : 0.0;
            const double right = (i + 1) % cols ? t[1] - t[0] : 0.0;
            out[i] += below * below + right * right;
        }
}

/* What smoothing works with. */
typedef struct smoothing {
    hada_map_size size;
    double *given, *data, *bound; /* depth as it came, its weight, the dual's bound */
    double *now, *ahead, *dual_y, *dual_x;
} smoothing;

static void smooth_dual(const smoothing *s)
{
    const size_t area = area_of(s->size), cols = (size_t)s->size.cols;
    for (size_t i = 0; i < area; i++) {
        const double y = s->dual_y[i] + (i + cols < area ? STEP * (s->ahead[i + cols] - s->ahead[i]) : 0.0);
        const double x = s->dual_x[i] + ((i + 1) % cols ? STEP * (s->ahead[i + 1] - s->ahead[i]) : 0.0);
        const double norm = sqrt(y * y + x * x), shorten = norm > s->bound[i] ? s->bound[i] / norm : 1.0;
        s->dual_y[i] = shorten * y;
        s->dual_x[i] = shorten * x;
    }
}

static void smooth_primal(const smoothing *s)
{
    const size_t area = area_of(s->size), cols = (size_t)s->size.cols;
    for (size_t i = 0; i < area; i++) {
        const double divergence =
            s->dual_y[i] - (i >= cols ? s->dual_y[i - cols] : 0.0) + s->dual_x[i] - (i % cols ? s->dual_x[i - 1] : 0.0);
        const double next = (s->now[i] + STEP * (divergence + s->data[i] * s->given[i])) / (1.0 + STEP * s->data[i]);
        s->ahead[i] = 2.0 * next - s->now[i];
        s->now[i] = next;
    }
}

static double mean_of(const float *values, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; i++)
        sum += values[i];
    return count ? sum / (double)count : 0.0;
}

hada_status hada_map_smooth(float *depth, const float *light, const float *texture, int channels, hada_map_size size,
                            const hada_map_rule *rule, hada_error *err)
{
    const size_t area = area_of(size);
    const double mean_light = mean_of(light, area), mean = mean_of(texture, area * (size_t)channels);
    double *memory = NULL;
    hada_status status = HADA_OK;
    if (!(mean_light > 0.0) || !(mean > 0.0))
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW(memory, 7 * area, what, err));
    const smoothing s = {size,
                         memory,
                         memory + area,
                         memory + 2 * area,
                         memory + 3 * area,
                         memory + 4 * area,
                         memory + 5 * area,
                         memory + 6 * area};
    gradient_squares(texture, channels, size, s.bound);
    for (size_t i = 0; i < area; i++) {
        s.given[i] = s.now[i] = s.ahead[i] = depth[i];
        s.data[i] = rule->data * light[i] / mean_light;
        s.bound[i] = rule->weight * exp(-sqrt(s.bound[i]) / (rule->tolerance * mean));
    }
    for (int k = 0; k < rule->steps; k++) {
        smooth_dual(&s);
        smooth_primal(&s);
    }
    for (size_t i = 0; i < area; i++)
        depth[i] = (float)s.now[i];
done:
    free(memory);
    return status;
}

/* Sums over 2 radius + 1 pixels of a line, fewer at its ends. */
static void sum_line(int radius, int n, size_t step, const double *in, double *out)
{
    double sum = 0.0;
    for (int i = 0; i < radius && i < n; i++)
        sum += in[(size_t)i * step];
    for (int i = 0; i < n; i++) {
        sum += i + radius < n ? in[(size_t)(i + radius) * step] : 0.0;
        sum -= i > radius ? in[(size_t)(i - radius - 1) * step] : 0.0;
        out[(size_t)i * step] = sum;
    }
}

/* The mean square distance of the depths round a pixel from the plane through them. */
static double bend_square(const float *depth, hada_map_size size, int y, int x)
{
    const double pixels = (2.0 * BEND_RADIUS + 1.0) * (2.0 * BEND_RADIUS + 1.0);
    /* of i^2, or of j^2, over them */
    const double inertia = pixels * BEND_RADIUS * (BEND_RADIUS + 1.0) / 3.0;
    double sum = 0.0, square = 0.0, down = 0.0, along = 0.0;
    for (int i = -BEND_RADIUS; i <= BEND_RADIUS; i++)
        for (int j = -BEND_RADIUS; j <= BEND_RADIUS; j++) {
            const size_t row = (size_t)hada_within(y + i, size.rows), col = (size_t)hada_within(x + j, size.cols);
            const double d = depth[row * (size_t)size.cols + col];
            sum += d;
            square += d * d;
            down += i * d;
            along += j * d;
        }
    return fmax((square - sum * sum / pixels - (down * down + along * along) / inertia) / pixels, 0.0);
}

hada_status hada_map_confidence(const float *texture, int channels, const float *depth, hada_map_size size,
                                double noise, const double *shift, int depths, int radius, float *confidence,
                                hada_error *err)
{
    const size_t area = area_of(size);
    double *memory = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(memory, 2 * area, what, err));
    double *work = memory + area;
    gradient_squares(texture, channels, size, memory);
    for (int y = 0; y < size.rows; y++)
        sum_line(radius, size.cols, 1, memory + (size_t)y * (size_t)size.cols, work + (size_t)y * (size_t)size.cols);
    for (int x = 0; x < size.cols; x++)
        sum_line(radius, size.rows, (size_t)size.cols, work + x, memory + x);
    for (size_t i = 0; i < area; i++) {
        const double moved = shift[hada_within((int)lround(depth[i]), depths)];
        const double seen = moved * moved * fmax(memory[i], 0.0);
        const double bend = bend_square(depth, size, (int)(i / (size_t)size.cols), (int)(i % (size_t)size.cols));
        /* variances over 0.5^2 */
        confidence[i] = seen > 0.0 ? (float)(1.0 / (1.0 + 4.0 * (noise * noise / seen + BEND * BEND * bend))) : 0.0F;
    }
done:
    free(memory);
    return status;
}
