#include "io/text.h"

#include <stdarg.h>

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
