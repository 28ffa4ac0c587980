/* Growing text, numbers without a locale, and encodings of values. */
#include <hadalens/response.h>
#include <stdarg.h>

#include "core/outfile.h"
#include "io/text.h"

/* sRGB, IEC 61966-2-1: a straight line near black, a power above. The line ends at 0.04045 of the encoding. */
#define LINE_SLOPE 12.92
#define LINE_END   0.04045
#define OFFSET     0.055
#define EXPONENT   2.4

int hada_response_is_known(double response)
{
    return response == HADA_RESPONSE_SRGB || (response >= HADA_RESPONSE_LEAST && response <= HADA_RESPONSE_MOST);
}

double hada_response_to_light(double response, double value)
{
    if (response == HADA_RESPONSE_LINEAR || isnan(value))
        return value;
    if (value <= 0.0)
        return 0.0;
    if (response == HADA_RESPONSE_SRGB)
        return value <= LINE_END ? value / LINE_SLOPE : pow((value + OFFSET) / (1.0 + OFFSET), EXPONENT);
    return pow(value, response);
}

double hada_response_from_light(double response, double light)
{
    if (response == HADA_RESPONSE_LINEAR || isnan(light))
        return light;
    if (light <= 0.0)
        return 0.0;
    if (response == HADA_RESPONSE_SRGB)
        return light <= LINE_END / LINE_SLOPE ? light * LINE_SLOPE
                                              : (1.0 + OFFSET) * pow(light, 1.0 / EXPONENT) - OFFSET;
    return pow(light, 1.0 / response);
}

/* value^power in single precision, 0 below 0; NaN stays. */
static void raise_all(float *values, size_t count, float power)
{
    for (size_t i = 0; i < count; i++)
        values[i] = values[i] <= 0.0f ? 0.0f : powf(values[i], power);
}

static void square_all(float *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        values[i] = values[i] <= 0.0f ? 0.0f : values[i] * values[i];
}

/* The double-precision curve costs four times what powf() does, and pairs are many; powf() is good to a unit in the
 * last place. */
static void srgb_to_light(float *values, size_t count)
{
    const float slope = (float)LINE_SLOPE, end = (float)LINE_END, offset = (float)OFFSET, whole = (float)(1.0 + OFFSET);
    for (size_t i = 0; i < count; i++) {
        const float v = values[i];
        values[i] = v <= 0.0f ? 0.0f : v <= end ? v / slope : powf((v + offset) / whole, (float)EXPONENT);
    }
}

static void srgb_from_light(float *values, size_t count)
{
    const float slope = (float)LINE_SLOPE, end = (float)(LINE_END / LINE_SLOPE);
    const float offset = (float)OFFSET, whole = (float)(1.0 + OFFSET);
    for (size_t i = 0; i < count; i++) {
        const float v = values[i];
        values[i] = v <= 0.0f ? 0.0f : v <= end ? v * slope : whole * powf(v, (float)(1.0 / EXPONENT)) - offset;
    }
}

void hada_response_convert(float *values, size_t count, double from, double to)
{
    if (!values)
        return;
    if (from == to)
        return;
    if (from != HADA_RESPONSE_SRGB && to != HADA_RESPONSE_SRGB) {
        if (from / to == 2.0)
            square_all(values, count);
        else
            raise_all(values, count, (float)(from / to));
        return;
    }
    if (from == HADA_RESPONSE_SRGB)
        srgb_to_light(values, count);
    else if (from != HADA_RESPONSE_LINEAR)
        raise_all(values, count, (float)from);
    if (to == HADA_RESPONSE_SRGB)
        srgb_from_light(values, count);
    else if (to != HADA_RESPONSE_LINEAR)
        raise_all(values, count, (float)(1.0 / to));
}

void hada_response_name(char name[HADA_RESPONSE_NAME], double response)
{
    if (!name)
        return;
    const char *word = response == HADA_RESPONSE_LINEAR ? "linear"
                       : response == HADA_RESPONSE_SRGB ? "srgb"
                       : response == HADA_AUTO          ? "auto"
                                                        : NULL;
    if (word)
        memcpy(name, word, strlen(word) + 1);
    else
        hada_format_number(name, HADA_RESPONSE_NAME, "%.15g", response);
}

hada_status hada_response_from_name(double *response, const char *name, hada_error *err)
{
    HADA_NEED(response && name, err);
    static const double words[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, HADA_AUTO};
    char word[HADA_RESPONSE_NAME];
    const char *end;
    for (size_t i = 0; i < sizeof words / sizeof *words; i++) {
        hada_response_name(word, words[i]);
        if (!strcmp(name, word)) {
            *response = words[i];
            return HADA_OK;
        }
    }
    const double power = hada_text_number(name, &end);
    if (end == name || *end || power < HADA_RESPONSE_LEAST || power > HADA_RESPONSE_MOST)
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "'%s' is no response: it is 'linear', 'srgb', or a power from 0.2 to 5 such as 2.2", name);
    *response = power;
    return HADA_OK;
}

void hada_text_add(hada_text *text, const char *format, ...)
{
    for (int attempt = 0; attempt < 2 && !text->failed; attempt++) {
        va_list arguments;
        va_start(arguments, format);
        size_t left = text->room - text->length;
        int needed = vsnprintf(text->data ? text->data + text->length : NULL, left, format, arguments);
        va_end(arguments);
        if (needed < 0) {
            text->failed = 1;
        } else if ((size_t)needed < left) {
            text->length += (size_t)needed;
            return;
        } else {
            size_t room = (text->room + (size_t)needed + 64) * 2;
            char *grown = realloc(text->data, room);
            text->failed = !grown;
            if (grown) {
                text->data = grown;
                text->room = room;
            }
        }
    }
}

hada_status hada_text_save(hada_text *text, const char *path, hada_error *err)
{
    const hada_status status = text->failed ? hada_fail(err, HADA_ERROR_MEMORY, "no memory for %s", path)
                                            : hada_outfile_save(path, text->data, text->length, err);
    free(text->data);
    *text = (hada_text){0};
    return status;
}

void hada_format_number(char *out, size_t room, const char *format, double value)
{
    snprintf(out, room, format, value);
    /* The decimal sign of the locale may be any character, also one of several bytes. */
    char *sign = out + strspn(out, " +-0123456789eE");
    if (*sign && *sign != '.' && *sign != 'n' && *sign != 'i') {
        size_t bytes = strcspn(sign, "0123456789");
        *sign = '.';
        memmove(sign + 1, sign + bytes, strlen(sign + bytes) + 1);
    }
}

void hada_text_add_number(hada_text *text, double value)
{
    char digits[40];
    hada_format_number(digits, sizeof digits, "%.15g", value);
    hada_text_add(text, "%s", digits);
}

enum { LONGEST_NUMBER = 120 }; /* characters: seven times what any double needs */

/* The number of digits. */
static size_t digits(const char *at)
{
    return strspn(at, "0123456789");
}

/* The number of characters of the exponent at `at`, 0 without one. */
static size_t exponent(const char *at)
{
    if (*at != 'e' && *at != 'E')
        return 0;
    const size_t sign = at[1] == '-' || at[1] == '+', count = digits(at + 1 + sign);
    return count ? 1 + sign + count : 0;
}

double hada_text_number(const char *from, const char **end)
{
    /* strtod() wants the decimal sign of the locale, which is not ours to change: it gets what printf writes. */
    char zero[16], text[LONGEST_NUMBER + sizeof zero];
    const char *at = from + strspn(from, " \t");
    const size_t minus = *at == '-' || *at == '+', whole = digits(at + minus);
    const char *point = at + minus + whole;
    const size_t fraction = *point == '.' ? digits(point + 1) : 0;
    const char *rest = point + (*point == '.') + fraction;
    *end = from;
    if (!whole && !fraction)
        return 0;
    rest += exponent(rest);
    if (rest - at > LONGEST_NUMBER)
        return 0;
    snprintf(zero, sizeof zero, "%.1f", 0.0);
    const int sign_bytes = *point == '.' ? (int)strlen(zero) - 2 : 0;
    snprintf(text, sizeof text, "%.*s%.*s%.*s", (int)(point - at), at, sign_bytes, zero + 1,
             (int)(rest - point) - (*point == '.'), point + (*point == '.'));
    *end = rest;
    return strtod(text, NULL);
}

void hada_format_exact(char *out, size_t room, double value)
{
    static const char *const formats[] = {"%g",    "%.7g",  "%.8g",  "%.9g",  "%.10g", "%.11g",
                                          "%.12g", "%.13g", "%.14g", "%.15g", "%.16g", "%.17g"};
    const char *end;
    for (size_t i = 0; i < sizeof formats / sizeof *formats; i++) {
        hada_format_number(out, room, formats[i], value);
        if (hada_text_number(out, &end) == value)
            return;
    }
}
