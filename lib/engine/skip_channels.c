/* Channels that need no computing: black ones, and those that equal an earlier one. */
#include <string.h>

#include "engine/skip.h"
#include "filter/hadamard.h"

/* Whether nothing is left of a channel when the dark level and the dark frame are off: in float, as the device does
 * it. */
static int is_black(const hada_frame *frame, int channel)
{
    const hada_image *image = frame->staged, *dark = &frame->setup->dark_frame;
    const size_t pixels = (size_t)image->rows * (size_t)image->cols, at = (size_t)channel * pixels;
    const float *values = image->data + at, *background = dark->data ? dark->data + at : NULL;
    const float level = (float)frame->levels[channel];
    for (size_t i = 0; i < pixels; i++)
        if ((values[i] - level) - (background ? background[i] : 0.0f) != 0.0f)
            return 0;
    return 1;
}

static int is_same(const hada_frame *frame, int a, int b)
{
    const hada_image *image = frame->staged;
    const int *dark = frame->setup->same_dark;
    const size_t pixels = (size_t)image->rows * (size_t)image->cols;
    return frame->levels[a] == frame->levels[b] && dark[a] == dark[b] &&
           !memcmp(image->data + (size_t)a * pixels, image->data + (size_t)b * pixels, pixels * sizeof(float));
}

/* The first channels whose spectrum and whose planes are those of channel c. */
static void find_source(const hada_frame *frame, int c, int *spectrum, int *planes)
{
    const int joint = frame->setup->config.joint, *same_filter = frame->setup->same_filter;
    *spectrum = *planes = c;
    if (is_black(frame, c)) {
        *spectrum = HADA_CHANNEL_BLACK;
        *planes = joint ? c : HADA_CHANNEL_BLACK;
        return;
    }
    for (int before = c - 1; before >= 0; before--)
        if (is_same(frame, before, c)) {
            *spectrum = before;
            if (!joint && same_filter[before] == same_filter[c])
                *planes = before;
        }
}

void hada_skip_channels(hada_frame *frame)
{
    hada_frame_skip *skip = &frame->skip;
    skip->channels = 0;
    for (int c = 0; c < frame->staged->channels; c++) {
        skip->spectra[c] = skip->planes[c] = c;
        if (frame->setup->options.skip & HADA_SKIP_CHANNELS)
            find_source(frame, c, &skip->spectra[c], &skip->planes[c]);
        skip->channels += skip->planes[c] != c;
    }
}
