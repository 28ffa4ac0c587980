/* A program that was built against other headers than the library's, and runs with today's library: against those that
 * were frozen (OTHER 0), against older ones whose structs end earlier (1), against newer ones with a member more (2).
 * Needs no device. */
#include <hadalens/hadalens.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define CHECK(condition)                                                                                               \
    do {                                                                                                               \
        if (!(condition)) {                                                                                            \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #condition, err.message);                           \
            exit(1);                                                                                                   \
        }                                                                                                              \
    } while (0)

enum { BEHIND = 64, FILL = 0xa5 };
static hada_error err;

/* Nothing behind the caller's struct may be written. */
static int untouched(const unsigned char *behind)
{
    for (int i = 0; i < BEHIND; i++)
        if (behind[i] != FILL)
            return 0;
    return 1;
}

static void makes_a_net(void)
{
    struct {
        hada_unet_options options;
        unsigned char behind[BEHIND];
    } caller;
    hada_net *net;
    memset(&caller, FILL, sizeof caller);
    hada_unet_options_init(&caller.options);
    CHECK(untouched(caller.behind) && caller.options.size == sizeof caller.options);
    caller.options.down = "4,4|8,8";
    caller.options.up = "4,4";
    CHECK(hada_net_create_unet(&net, &caller.options, 1, &err) == HADA_OK);
    hada_net_destroy(&net);
#if OTHER == 2
    caller.options.unknown = 1.0;
    CHECK(hada_net_create_unet(&net, &caller.options, 1, &err) == HADA_ERROR_UNSUPPORTED);
    CHECK(strstr(err.message, "update the library"));
#endif
}

static void makes_a_camera(void)
{
    struct {
        hada_camera camera;
        unsigned char behind[BEHIND];
    } caller;
    struct {
        hada_sensor sensor;
        unsigned char behind[BEHIND];
    } eye;
    hada_image psf;
    memset(&caller, FILL, sizeof caller);
    memset(&eye, FILL, sizeof eye);
    caller.camera.size = sizeof caller.camera;
    CHECK(hada_camera_preset(&caller.camera, "sim300", &err) == HADA_OK);
    CHECK(hada_camera_resize(&caller.camera, 30, 40, 12, 12, &err) == HADA_OK);
    CHECK(hada_camera_psf(&caller.camera, 200.0, 0, 0, &psf, &err) == HADA_OK);
    CHECK(psf.rows == 30 && psf.cols == 40);
    CHECK(untouched(caller.behind));
    hada_sensor_init(&eye.sensor);
    eye.sensor.bits = 12;
    CHECK(hada_sensor_check(&eye.sensor, &err) == HADA_OK);
    CHECK(untouched(eye.behind));
    hada_image_destroy(&psf);
}

static void measures_a_map(void)
{
    struct {
        hada_depth_score score;
        unsigned char behind[BEHIND];
    } caller;
    hada_image map, truth;
    memset(&caller, FILL, sizeof caller);
    caller.score.size = sizeof caller.score;
    CHECK(hada_image_create(&map, 1, 2, 2, &err) == HADA_OK && hada_image_create(&truth, 1, 2, 2, &err) == HADA_OK);
    for (int i = 0; i < 4; i++)
        map.data[i] = truth.data[i] = 100.0f;
    CHECK(hada_metric_depth(&map, &truth, NULL, 0, 1.0, NULL, &caller.score, &err) == HADA_OK);
    CHECK(caller.score.coverage == 1.0 && caller.score.within == 1.0);
    CHECK(caller.score.size == sizeof caller.score && untouched(caller.behind));
    hada_image_destroy(&map);
    hada_image_destroy(&truth);
}

int main(void)
{
    makes_a_net();
    makes_a_camera();
    measures_a_map();
    printf("headers %s, library %s\n", HADALENS_VERSION, hada_version());
    return 0;
}
