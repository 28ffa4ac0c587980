#include "io/colormap.h"

#include <math.h>

static unsigned char to_srgb(double linear)
{
    double value = linear <= 0.0031308 ? 12.92 * linear : 1.055 * pow(linear, 1 / 2.4) - 0.055;
    return (unsigned char)(fmin(fmax(value, 0), 1) * 255 + 0.5);
}

void hada_colormap(double at, unsigned char rgb[3])
{
    at = fmin(fmax(at, 0), 1);
    double lightness = 0.32 + 0.61 * at, hue = (360 - 260 * at) * 3.14159265358979323846 / 180;
    double a = 0.115 * cos(hue), b = 0.115 * sin(hue);
    /* Oklab to linear sRGB, with the constants of its definition. */
    double l = pow(lightness + 0.3963377774 * a + 0.2158037573 * b, 3);
    double m = pow(lightness - 0.1055613458 * a - 0.0638541728 * b, 3);
    double s = pow(lightness - 0.0894841775 * a - 1.2914855480 * b, 3);
    rgb[0] = to_srgb(4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s);
    rgb[1] = to_srgb(-1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s);
    rgb[2] = to_srgb(-0.0041960863 * l - 0.7034186147 * m + 1.7076147010 * s);
}
