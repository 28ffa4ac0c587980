#include "io/text.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
