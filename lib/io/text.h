/* Growing text, independent of the program's locale. Internal. */
#ifndef HADA_IO_TEXT_H
#define HADA_IO_TEXT_H

#include "core/base.h"

typedef struct hada_text {
    char *data; /* NUL-terminated once something was added; to be freed by the owner */
    size_t length, room;
    int failed; /* memory ran out: later additions do nothing */
} hada_text;

/* Not for floating point, which would follow the locale. */
void hada_text_add(hada_text *text, const char *format, ...) HADA_PRINTF(2, 3);
/* The shortest decimal that reads back as `value` to 15 digits. */
void hada_text_add_number(hada_text *text, double value);
/* Writes it to a file that appears whole or not at all, and empties it. */
hada_status hada_text_save(hada_text *text, const char *path, hada_error *err);
/* As snprintf with "%*.*e" or "%.*g", with a decimal point. */
void hada_format_number(char *out, size_t room, const char *format, double value);
/* The shortest decimal, of 6 digits at least where there are as many, that reads back as the same value: numbers that
 * differ have names that differ. */
void hada_format_exact(char *out, size_t room, double value);
/* The decimal number at `from` behind blanks, correctly rounded, '.' being the decimal point whatever the locale is. 0
 * and *end == from where there is none, or one of more than 120 characters. */
double hada_text_number(const char *from, const char **end);

/* One value of a response (hadalens/response.h) to light, and back. */
double hada_response_to_light(double response, double value);
double hada_response_from_light(double response, double light);

#endif
