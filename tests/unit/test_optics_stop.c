/* Designed cameras whose light takes long can be stopped, wherever they are asked, and leave nothing behind. */
#include "device_fixture.h"

enum { ROWS = 24, COLS = 30, WINDOW = 12 };

/* Says stop when it is asked for the n-th time; 0: never. */
typedef struct asked {
    long count, stop_at;
} asked;

static int stops(void *user)
{
    asked *a = user;
    return ++a->count == a->stop_at || (a->stop_at && a->count > a->stop_at);
}

static hada_camera camera_of(hada_mask mask, hada_optics optics)
{
    hada_camera camera = {.size = sizeof camera};
    ASSERT_OK(hada_camera_preset(&camera, "sim300", err));
    ASSERT_OK(hada_camera_resize(&camera, ROWS, COLS, WINDOW, WINDOW, err));
    ASSERT_OK(hada_camera_set_depths(&camera, 100.0, 300.0, 2, err));
    camera.channels = 1;
    camera.lenses = 5;
    camera.optics = optics;
    ASSERT_OK(hada_camera_set_mask(&camera, mask, err));
    if (optics == HADA_OPTICS_WAVE && mask != HADA_MASK_MLA) { /* few samples */
        camera.aperture_mm = 2.0;
        camera.correlation_mm = 0.5;
        camera.deflection_mrad = 2.0;
        camera.lens_diameter_mm = 0.1;
        camera.minimum_spacing_mm = 0.0;
    }
    return camera;
}

/* A frame of a white window. */
static hada_status render(const hada_camera *camera, asked *who, hada_image *frame, hada_error *why)
{
    hada_simulator *simulator = NULL;
    hada_image white = {0};
    hada_status status;
    DEFAULTS(hada_monitor, monitor);
    monitor.user = who;
    monitor.cancelled = stops;
    DEFAULTS(hada_simulator_options, options);
    options.monitor = &monitor;
    *frame = (hada_image){0};
    if ((status = hada_simulator_create(&simulator, context, camera, &options, why)))
        return status;
    ASSERT_OK(hada_image_create(&white, 1, WINDOW, WINDOW, err));
    for (size_t i = 0; i < hada_image_count(&white); i++)
        white.data[i] = 1.0f;
    const hada_plane planes[] = {{0, &white}, {1, &white}};
    status = hada_simulator_render(simulator, planes, 2, 0.0, 0, frame, why);
    hada_image_destroy(&white);
    hada_simulator_destroy(&simulator);
    return status;
}

TEST(stopped_anywhere)
{
    static const struct {
        hada_mask mask;
        hada_optics optics;
        long least; /* times that it is asked, at least: for every row of rays, batch of lenses, row of a mask */
    } cases[] = {{HADA_MASK_MLA, HADA_OPTICS_GEOMETRY, 100},     {HADA_MASK_DIFFUSER, HADA_OPTICS_GEOMETRY, 100},
                 {HADA_MASK_CONTOUR, HADA_OPTICS_GEOMETRY, 100}, {HADA_MASK_MLA, HADA_OPTICS_WAVE, 7},
                 {HADA_MASK_DIFFUSER, HADA_OPTICS_WAVE, 100},    {HADA_MASK_CONTOUR, HADA_OPTICS_WAVE, 100}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const hada_camera camera = camera_of(cases[i].mask, cases[i].optics);
        asked never = {0};
        hada_image frame;
        ASSERT_OK(render(&camera, &never, &frame, err));
        assert_true(never.count >= cases[i].least);
        hada_image_destroy(&frame);
        for (int k = 0; k < 3; k++) { /* at the first, at the last, and between */
            asked once = {.stop_at = 1 + k * (never.count - 1) / 2};
            ASSERT_FAILS(render(&camera, &once, &frame, err), HADA_ERROR_CANCELLED, "");
            assert_int_equal(once.count, once.stop_at); /* the work ends there */
            assert_null(frame.data);
        }
    }
}

/* Stopped once, a simulator does its work when it is asked again. */
TEST(goes_on_afterwards)
{
    const hada_camera camera = camera_of(HADA_MASK_DIFFUSER, HADA_OPTICS_WAVE);
    asked who = {.stop_at = 4};
    SCOPED(hada_wave) * wave;
    SCOPED(hada_image) psf, again;
    DEFAULTS(hada_monitor, monitor);
    monitor.user = &who;
    monitor.cancelled = stops;
    DEFAULTS(hada_wave_options, options);
    options.monitor = &monitor;
    ASSERT_OK(hada_wave_create(&wave, context, &camera, &options, err));
    ASSERT_FAILS(hada_wave_psf(wave, 100.0, ROWS, COLS, &psf, err), HADA_ERROR_CANCELLED, "");
    assert_null(psf.data);
    who.stop_at = 0;
    ASSERT_OK(hada_wave_psf(wave, 100.0, ROWS, COLS, &psf, err));
    hada_wave_destroy(&wave);
    ASSERT_OK(hada_wave_create(&wave, context, &camera, NULL, err));
    ASSERT_OK(hada_wave_psf(wave, 100.0, ROWS, COLS, &again, err));
    assert_memory_equal(psf.data, again.data, hada_image_count(&psf) * sizeof(float));
}

/* Numbers of a camera that would take hours are refused, whatever file they come from. */
TEST(too_much_is_refused)
{
    hada_camera camera = camera_of(HADA_MASK_MLA, HADA_OPTICS_GEOMETRY);
    hada_image psf;
    double x[4096], y[4096];
    camera.lenses = 29;
    camera.pixel_pitch_mm = 1e-6;
    ASSERT_FAILS(hada_camera_psf(&camera, 100.0, 0, 0, &psf, err), HADA_ERROR_UNSUPPORTED, "larger pixels");
    camera.pixel_pitch_mm = 0.4;
    ASSERT_FAILS(hada_camera_psf(&camera, 1e-300, 0, 0, &psf, err), HADA_ERROR_UNSUPPORTED, "");
    camera.lenses = 4096;
    camera.minimum_spacing_mm = 0.0;
    camera.blur_pixels = 64.0;
    ASSERT_FAILS(hada_camera_psf(&camera, 100.0, 0, 0, &psf, err), HADA_ERROR_UNSUPPORTED, "");
    assert_null(psf.data);
    camera.minimum_spacing_mm = 0.16; /* more than fit, by little */
    ASSERT_FAILS(hada_camera_lenses(&camera, x, y, err), HADA_ERROR_ARGUMENT, "do not fit");
}

FIXTURE(open_device, close_device)
