/* Time of a stack of PSFs by wave optics, a depth after the other: perf_optics [PRESET [MASK [COHERENT [ROUNDS]]]].
 * Prints the seconds of each round (the first compiles or loads programs) and of each depth in the last. */
#include <hadalens/hadalens.h>
#include <stdio.h>
#include <stdlib.h>

#include "core/clock.h"

static int stop(const hada_error *err)
{
    fprintf(stderr, "perf_optics: %s\n", err->message);
    return 1;
}

int main(int count, char **arguments)
{
    const char *preset = count > 1 ? arguments[1] : "paper2022", *mask = count > 2 ? arguments[2] : "mla";
    const int rounds = count > 4 ? atoi(arguments[4]) : 3;
    hada_context *context;
    hada_error err = {0};
    hada_camera camera = {.size = sizeof camera};
    hada_wave_options options;
    hada_wave_options_init(&options);
    options.coherent = count > 3 ? atoi(arguments[3]) : 0;
    if (hada_camera_preset(&camera, preset, &err) ||
        hada_camera_set_mask(&camera, (hada_mask)hada_enum_value(HADA_ENUM_MASK, mask), &err) ||
        hada_context_create(&context, NULL, &err))
        return stop(&err);
    printf("%s, mask %s, %d x %d, %d channels, %d depths%s\n", preset, mask, camera.rows, camera.cols, camera.channels,
           camera.depths, options.coherent ? ", coherent" : "");
    for (int round = 0; round < rounds; round++) {
        hada_wave *wave;
        const double begin = hada_seconds();
        if (hada_wave_create(&wave, context, &camera, &options, &err))
            return stop(&err);
        for (int z = 0; z < camera.depths; z++) {
            hada_image psf;
            const double start = hada_seconds();
            if (hada_wave_psf(wave, camera.distances_mm[z], camera.rows, camera.cols, &psf, &err))
                return stop(&err);
            if (round + 1 == rounds)
                printf("  %7.1f mm %6.2f s\n", camera.distances_mm[z], hada_seconds() - start);
            hada_image_destroy(&psf);
        }
        hada_wave_destroy(&wave);
        printf("round %d: %.2f s\n", round + 1, hada_seconds() - begin);
    }
    hada_context_destroy(&context);
    return 0;
}
