/* Learning rates: pure functions of the step. */
#include <math.h>

#include "net/optimizer.h"

#define PI 3.14159265358979323846

static int is_rate(double rate)
{
    return rate >= 0.0 && isfinite(rate);
}

hada_status hada_schedule_validate(const hada_schedule *schedule, hada_error *err)
{
    if ((int)schedule->kind < HADA_SCHEDULE_CONSTANT || schedule->kind > HADA_SCHEDULE_COSINE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no schedule %d", (int)schedule->kind);
    if (!is_rate(schedule->rate) || !is_rate(schedule->factor) || !is_rate(schedule->last))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "learning rates and factors must be at least 0, not %g, %g and %g",
                         schedule->rate, schedule->factor, schedule->last);
    if (schedule->kind != HADA_SCHEDULE_CONSTANT && !schedule->period)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a schedule that changes needs a period of at least one step");
    if (!(schedule->warmup_from >= 0.0 && schedule->warmup_from <= 1.0))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a warm-up from %g of the rate is not possible; take 0 to 1",
                         schedule->warmup_from);
    return HADA_OK;
}

double hada_schedule_rate(const hada_schedule *schedule, uint64_t step)
{
    const double rate = schedule->rate;
    if (step < schedule->warmup) {
        const double done = (double)step / (double)schedule->warmup;
        return rate * (schedule->warmup_from + (1.0 - schedule->warmup_from) * done);
    }
    step -= schedule->warmup;
    if (schedule->kind == HADA_SCHEDULE_STEP)
        return rate * pow(schedule->factor, (double)(step / schedule->period));
    if (schedule->kind == HADA_SCHEDULE_COSINE) {
        if (step >= schedule->period)
            return schedule->last;
        const double turn = cos(PI * (double)step / (double)schedule->period);
        return schedule->last + (rate - schedule->last) * (1.0 + turn) / 2.0;
    }
    return rate;
}
