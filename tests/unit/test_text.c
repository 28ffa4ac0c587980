/* Numbers of text files: read and written alike whatever the locale is. */
#include "comma.h"
#include "io/text.h"
#include "testing.h"

/* The number and how many characters it took. */
static double read_number(const char *text, size_t *used)
{
    const char *end;
    const double value = hada_text_number(text, &end);
    *used = (size_t)(end - text);
    return value;
}

TEST(what_a_number_is)
{
    static const struct {
        const char *text;
        double value;
        size_t used;
    } cases[] = {
        {"0", 0, 1},
        {"12x34", 12, 2},
        {" \t-1.5,2", -1.5, 6},
        {"+3.", 3, 3},
        {".25mm", 0.25, 3},
        {"1e3", 1000, 3},
        {"1E-2z", 0.01, 4},
        {"2e", 2, 1},
        {"2e+", 2, 1},
        {"7,5", 7, 1},
        {"1e400", HUGE_VAL, 5},
        {"-1e-400", 0, 7},
        {"0x10", 0, 1},
        {"", 0, 0},
        {"-", 0, 0},
        {".", 0, 0},
        {"-.e1", 0, 0},
        {"nan", 0, 0},
        {"inf", 0, 0},
        {"\n1", 0, 0},
    };
    size_t used;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        assert_true(read_number(cases[i].text, &used) == cases[i].value);
        assert_int_equal(used, cases[i].used);
    }
    char text[200];
    memset(text, '1', sizeof text);
    text[120] = 0;
    assert_true(read_number(text, &used) > 1e119);
    assert_int_equal(used, 120);
    text[120] = '1';
    text[121] = 0; /* longer than any number is: not one */
    assert_true(read_number(text, &used) == 0);
    assert_int_equal(used, 0);
}

/* 17 digits come back to the bit, with a point; also doubles that end below the normal ones. */
static void every_double_comes_back(void)
{
    char text[40];
    size_t used;
    hada_random random;
    hada_random_seed(&random, 7, 0);
    for (int i = 0; i < 20000; i++) {
        double value = 0;
        const uint64_t bits = (uint64_t)hada_random_bits(&random) << 32 | hada_random_bits(&random);
        memcpy(&value, &bits, sizeof value);
        if (!isfinite(value))
            continue;
        hada_format_number(text, sizeof text, "%.17g", value);
        assert_null(strchr(text, ','));
        assert_true(read_number(text, &used) == value);
        assert_int_equal(used, strlen(text));
    }
}

TEST(doubles_with_a_point)
{
    every_double_comes_back();
}

TEST(numbers_that_differ_have_names_that_differ)
{
    static const struct {
        double value;
        const char *name;
    } cases[] = {{100, "100"},
                 {12345.67, "12345.67"},
                 {0.1, "0.1"},
                 {1.0 / 3.0, "0.3333333333333333"},
                 {250.00001, "250.00001"},
                 {123456789, "123456789"},
                 {1e-7, "1e-07"}};
    char name[40];
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        hada_format_exact(name, sizeof name, cases[i].value);
        assert_string_equal(name, cases[i].name);
    }
}

TEST(doubles_where_people_write_a_comma)
{
    if (!decimal_comma())
        skip();
    what_a_number_is(state);
    every_double_comes_back();
    assert_string_equal(localeconv()->decimal_point, ","); /* the program's locale is left alone */
    setlocale(LC_NUMERIC, "C");
}
