/* Curves between encodings and light: against the standard's own numbers, each other, and their names. */
#include "testing.h"

#include "io/text.h"

static void close_to(double value, double expected, double tolerance)
{
    if (!(fabs(value - expected) <= tolerance))
        fail_msg("%.12g is not within %g of %.12g", value, tolerance, expected);
}

static const double responses[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, 0.5, 1.5, 2.0, 2.2};
enum { RESPONSES = sizeof responses / sizeof *responses };

/* What the curves are by their definitions, worked out by hand. */
TEST(known_values)
{
    close_to(hada_response_to_light(HADA_RESPONSE_SRGB, 0.5), 0.2140411405, 1e-9); /* ((0.5 + 0.055) / 1.055)^2.4 */
    close_to(hada_response_to_light(HADA_RESPONSE_SRGB, 0.02), 0.02 / 12.92, 1e-15);
    close_to(hada_response_from_light(HADA_RESPONSE_SRGB, 0.18), 0.4613561295, 1e-9); /* 1.055 0.18^(1/2.4) - 0.055 */
    close_to(hada_response_to_light(2.0, 0.3), 0.09, 1e-15);
    close_to(hada_response_from_light(2.2, 0.5), 0.7297400528, 1e-9);
    close_to(hada_response_to_light(HADA_RESPONSE_LINEAR, -0.25), -0.25, 0);
    close_to(hada_response_from_light(HADA_RESPONSE_LINEAR, -0.25), -0.25, 0);
    for (int r = 0; r < RESPONSES; r++) {
        close_to(hada_response_to_light(responses[r], 0.0), 0.0, 0);
        close_to(hada_response_to_light(responses[r], 1.0), 1.0, 1e-15);
        assert_true(isnan(hada_response_to_light(responses[r], NAN)));
        assert_true(isnan(hada_response_from_light(responses[r], NAN)));
        if (r)
            close_to(hada_response_from_light(responses[r], -0.25), 0.0, 0);
    }
}

/* There and back, above 1 as well; and the arrays are the single values to the rounding of a few operations. */
TEST(arrays_are_values)
{
    for (int from = 0; from < RESPONSES; from++)
        for (int to = 0; to < RESPONSES; to++) {
            float values[64], start[64];
            for (int i = 0; i < 64; i++)
                start[i] = values[i] = (float)i / 40.0f - 0.1f;
            values[3] = start[3] = NAN;
            hada_response_convert(values, 64, responses[from], responses[to]);
            for (int i = 0; i < 64; i++) {
                const double light = hada_response_to_light(responses[from], (double)start[i]);
                const double expected =
                    from == to ? (double)start[i] : hada_response_from_light(responses[to], light > 0 ? light : 0);
                if (isnan(start[i]))
                    assert_true(isnan(values[i]));
                else /* the steepest: sRGB to the power 0.5 and back, each to a unit or two of single precision */
                    close_to((double)values[i], expected, 4e-6 * (1.0 + fabs(expected)));
            }
        }
}

TEST(names)
{
    static const double known[] = {HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB, HADA_AUTO, 2.2, 0.2, 5.0};
    static const char *const wrong[] = {"", "gamma", "0.1", "5.1", "-1", "2,2", "2.2x", "nan", "LINEAR", "-2"};
    char name[HADA_RESPONSE_NAME];
    double back;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        hada_response_name(name, known[i]);
        assert_int_equal(hada_response_from_name(&back, name, NULL), HADA_OK);
        assert_true(back == known[i]);
        assert_int_equal(hada_response_is_known(known[i]), known[i] != HADA_AUTO);
    }
    hada_response_name(name, 2.2);
    assert_string_equal(name, "2.2");
    assert_int_equal(hada_response_from_name(&back, "1", NULL), HADA_OK);
    hada_response_name(name, back);
    assert_string_equal(name, "linear");
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        back = 7.0;
        ASSERT_FAILS(hada_response_from_name(&back, wrong[i], err), HADA_ERROR_ARGUMENT, "srgb");
        assert_true(back == 7.0);
    }
    assert_int_equal(hada_response_is_known(NAN), 0);
    assert_int_equal(hada_response_is_known(0.0), 0);
}
