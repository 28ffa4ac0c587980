/* Options of the focus step, and which stacks can be focused. */
#include <limits.h>

#include "core/options.h"
#include "focus/focus.h"

void hada_focus_options_defaults(hada_focus_options *options, size_t size, int shared)
{
    const hada_focus_options own = {.size = sizeof own,
                                    .measure = shared ? HADA_FOCUS_COMBINED : HADA_FOCUS_CONTRAST,
                                    .fuse = shared ? HADA_FOCUS_SUM : HADA_FOCUS_WEIGHTED,
                                    .window_sigma = 2.5,
                                    .false_alarm = 0.01};
    HADA_OPTIONS_GIVE(options, size, &own);
}

hada_status hada_focus_check(const hada_focus_desc *desc, hada_error *err)
{
    const hada_focus_options *o = &desc->options;
    if ((o->measure != HADA_FOCUS_CONTRAST && o->measure != HADA_FOCUS_ENERGY && o->measure != HADA_FOCUS_COMBINED) ||
        (o->fuse != HADA_FOCUS_WEIGHTED && o->fuse != HADA_FOCUS_SUM))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "focus measure %d with fusion %d is not known", (int)o->measure,
                         (int)o->fuse);
    if (!(o->window_sigma >= 0.5 && o->window_sigma <= 20.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a focus window of %g pixels is not possible; use 0.5 to 20",
                         o->window_sigma);
    if (!(o->false_alarm > 0.0 && o->false_alarm < 0.5))
        return hada_fail(err, HADA_ERROR_ARGUMENT,
                         "a false alarm rate of %g is not possible; use a value above 0 and below 0.5", o->false_alarm);
    if ((desc->channels != 1 && desc->channels != 3) || desc->rows < 1 || desc->cols < 1 || desc->depths < 1)
        return hada_fail(err, HADA_ERROR_SIZE, "a stack of %d depths of %d channels, %d x %d cannot be focused",
                         desc->depths, desc->channels, desc->rows, desc->cols);
    /* kernels count pixels as int, in whole groups */
    if ((int64_t)desc->channels * desc->rows * desc->cols > INT_MAX - 256)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "planes of %d channels, %d x %d are too large to be focused: %d values "
                         "at most",
                         desc->channels, desc->rows, desc->cols, INT_MAX - 256);
    /* a camera of one depth may not know its distance: 0 */
    for (int i = 0; i < desc->depths && !(desc->depths == 1 && desc->distances_mm[0] == 0.0); i++)
        if (!(desc->distances_mm[i] > 0.0) || (i && !(desc->distances_mm[i] > desc->distances_mm[i - 1])))
            return hada_fail(err, HADA_ERROR_ARGUMENT,
                             "distance %d of %d (%g mm) is not possible; distances must be above 0 and rise", i + 1,
                             desc->depths, desc->distances_mm[i]);
    return HADA_OK;
}
