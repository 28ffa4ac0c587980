/* Words that others chose (names of files, texts in them), where a terminal and JSON have rules of their own. */
#include "cli.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Bytes of the character that begins here, 0 where it is none of UTF-8. */
static size_t character(const char *at)
{
    enum { LONGEST = 4 };
    for (size_t bytes = 1; bytes <= LONGEST && at[bytes - 1]; bytes++) {
        json_t *one = json_stringn(at, bytes);
        json_decref(one);
        if (one)
            return bytes;
    }
    return 0;
}

json_t *hada_cli_json_text(const char *text)
{
    static const char unknown[] = "\xef\xbf\xbd"; /* U+FFFD */
    json_t *plain = json_string(text);
    if (plain || !text)
        return plain;
    char *mended = hada_cli_memory((sizeof unknown - 1) * strlen(text) + 1, 1), *to = mended;
    for (size_t bytes; *text; text += bytes ? bytes : 1) {
        bytes = character(text);
        to = bytes ? (char *)memcpy(to, text, bytes) + bytes : stpcpy(to, unknown);
    }
    *to = '\0';
    plain = json_string(mended);
    free(mended);
    return plain;
}

/* Stands for an end of line of a format while the text is made. */
enum { LINE = 1 };

/* Controls of both sets become question marks, and what is no UTF-8, which may be one of the upper set. foreign: a
 * name holds LINE as well, so that none but the last is known. */
static void clean(char *text, int foreign)
{
    for (size_t bytes; *text; text += bytes) {
        const unsigned char *at = (unsigned char *)text;
        const size_t found = *at < 0x80 ? 1 : character(text);
        const int upper = found == 2 && at[0] == 0xc2 && at[1] < 0xa0; /* U+0080 to U+009F */
        bytes = found ? found : 1;
        if (*text == LINE && (!foreign || !text[1]))
            *text = '\n';
        else if (!found || upper || (*at < ' ' && *at != '\t') || *at == 0x7f)
            memset(text, '?', bytes);
    }
}

void hada_cli_put(FILE *to, const char *format, ...)
{
    va_list arguments;
    va_start(arguments, format);
    hada_cli_put_list(to, format, arguments);
    va_end(arguments);
}

void hada_cli_put_list(FILE *to, const char *format, va_list arguments)
{
    char *text = NULL, *marked = strdup(format);
    int lines = 0;
    for (char *at = marked; at && *at; at++)
        if (*at == '\n') {
            *at = LINE;
            lines++;
        }
    if (marked && vasprintf(&text, marked, arguments) >= 0) {
        for (const char *at = text; (at = strchr(at, LINE)); at++)
            lines--;
        clean(text, lines);
        fputs(text, to);
        free(text);
    }
    free(marked);
}
