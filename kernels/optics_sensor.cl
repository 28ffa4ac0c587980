/* From light to a sensor's reading: exposure, vignetting, shot noise, read noise, dark level, saturation, rounding, as
 * <hadalens/sensor.h> defines them. */
#include "inc_philox.h"
#include "shared_optics.h"

#define SENSOR_ROUNDS 10    /* of Philox */
#define SENSOR_EXACT  16.0f /* electrons; below, Poisson numbers are exact */

/* From words to multiples of 2^-24, above 0 and at most 1, exact in single precision. */
static inline float8 sensor_unit(uint8 word)
{
    return convert_float8((word >> 8) + 1) * 0x1p-24f;
}

/* Poisson numbers of large means: the expansion of a normal number by Cornish and Fisher (1938) to the second order,
 * with the variance less the 1/12 that rounding adds. */
static inline float8 sensor_many(float8 mean, float8 normal)
{
    const float8 square = normal * normal;
    const float8 off =
        sqrt(mean - 1.0f / 12.0f) * normal + (square - 1.0f) / 6.0f + (normal - square * normal) / (72.0f * sqrt(mean));
    return max(0.0f, rint(mean + off));
}

/* Poisson numbers of small means: how many uniform numbers can be multiplied until the product is no more than
 * exp(-mean) (Knuth, The Art of Computer Programming 2, 3.4.1). All eight go on until the last is done. */
static inline float8 sensor_few(float8 mean, const uint8 counter[4], uint key0, uint key1)
{
    const float8 least = exp(-mean);
    float8 product = 1.0f, count = 0.0f;
    int8 going = 1;
    for (uint turn = 1; any(going != 0); turn++) {
        uint8 word[4] = {counter[0], counter[1], counter[2] + turn, counter[3]};
        philox(word, SENSOR_ROUNDS, key0, key1);
        for (int i = 0; i < 4; i++) {
            product *= sensor_unit(word[i]);
            going = product > least;
            count += select((float8)0.0f, (float8)1.0f, going);
        }
    }
    return count;
}

/* `values` of `pixels` a channel, in place; an item takes eight. `gain` holds the vignetting, where there is one. */
__kernel void optics_sensor(__global float *values, const ulong offset, __global const float *gain, const ulong pixels,
                            const ulong count, const hada_optics_sensor sensor)
{
    const ulong first = 8 * (ulong)get_global_id(0);
    if (first >= count)
        return;
    const int here = (int)min((ulong)8, count - first);
    float lane[8] = {0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f, 0.0f};
    values += offset + first;
    for (int i = 0; i < here; i++)
        lane[i] = max(0.0f, values[i]) * (sensor.vignetted ? gain[(first + i) % pixels] : 1.0f);
    float8 y = sensor.exposure * vload8(0, lane);
    if (sensor.full_well > 0.0f || sensor.read_noise > 0.0f) {
        const uint8 counter[4] = {(uint)first + (uint8)(0, 1, 2, 3, 4, 5, 6, 7), (uint8)(uint)(first >> 32), 0, 0};
        uint8 word[4] = {counter[0], counter[1], counter[2], counter[3]};
        philox(word, SENSOR_ROUNDS, sensor.key0, sensor.key1);
        const float8 radius = sqrt(-2.0f * log(sensor_unit(word[0]))), turn = 2.0f * sensor_unit(word[1]);
        const float8 read = sensor.read_noise * radius * sinpi(turn);
        if (sensor.full_well > 0.0f) {
            const float8 mean = y * sensor.full_well;
            const int8 few = mean < SENSOR_EXACT;
            float8 electrons = sensor_many(max(mean, SENSOR_EXACT), radius * cospi(turn));
            if (any(few))
                electrons = select(electrons,
                                   sensor_few(select((float8)0.0f, mean, few), counter, sensor.key0, sensor.key1), few);
            if (sensor.saturate)
                electrons = min(electrons, sensor.full_well);
            y = (electrons + read) / sensor.full_well;
        } else {
            y = (sensor.saturate ? min(y, 1.0f) : y) + read;
        }
    } else if (sensor.saturate) {
        y = min(y, 1.0f);
    }
    y += sensor.dark_level;
    if (sensor.saturate)
        y = min(y, 1.0f);
    if (sensor.levels > 0.0f)
        y = clamp(rint(y * sensor.levels), 0.0f, sensor.levels) / sensor.levels;
    vstore8(y, 0, lane);
    for (int i = 0; i < here; i++)
        values[i] = lane[i];
}
