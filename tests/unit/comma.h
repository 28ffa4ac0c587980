/* A locale with a decimal comma for tests. tests/CMakeLists.txt makes "comma", where it can. */
#ifndef TESTS_COMMA_H
#define TESTS_COMMA_H

#include <locale.h>

/* Whether numbers now have a comma; until setlocale(LC_NUMERIC, "C"). */
static inline int decimal_comma(void)
{
    return setlocale(LC_NUMERIC, "comma") || setlocale(LC_NUMERIC, "de_DE.UTF-8") ||
           setlocale(LC_NUMERIC, "fr_FR.UTF-8");
}

#endif
