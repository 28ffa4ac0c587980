#include "picture/colormap.h"

#include <math.h>

static uint32_t to_srgb(double linear)
{
    double value = linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
    return (uint32_t)(fmin(fmax(value, 0), 1) * 255 + 0.5);
}

uint32_t hada_colormap(double at)
{
    at = fmin(fmax(at, 0), 1);
    double lightness = 0.32 + 0.61 * at, hue = (360 - 260 * at) * 3.14159265358979323846 / 180;
    double a = 0.115 * cos(hue), b = 0.115 * sin(hue);
    /* Oklab to linear sRGB, with the constants of its definition. */
    double l = pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
    double m = pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
    double s = pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
    const double red = 4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s;
    const double green = -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s;
    const double blue = -0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s;
    return to_srgb(red) << 16 | to_srgb(green) << 8 | to_srgb(blue);
}
