/* hadalens-aravis: frames of a GenICam camera (USB3 Vision, GigE Vision) to standard output, one after the other and
 * without a header, as `hadalens reconstruct --watch -` reads them. */
#include <arv.h>
#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

/* Frames that the camera may fill while one is written. */
enum { BUFFERS = 8, MICROSECONDS = 200000 };

typedef struct settings {
    char *camera, *pixels;
    double exposure_ms, gain_db, rate;
    int count, describe, list, fake;
} settings;

/* How `--headerless` calls the pixels that a camera may send; the others have to be changed with --pixels. */
static const struct {
    ArvPixelFormat format;
    const char *name;
    unsigned bytes; /* of a pixel */
} known[] = {
    {ARV_PIXEL_FORMAT_MONO_8, "u8", 1},       {ARV_PIXEL_FORMAT_MONO_10, "u10", 2},
    {ARV_PIXEL_FORMAT_MONO_12, "u12", 2},     {ARV_PIXEL_FORMAT_MONO_14, "u14", 2},
    {ARV_PIXEL_FORMAT_MONO_16, "u16", 2},     {ARV_PIXEL_FORMAT_RGB_8_PACKED, "rgb8", 3},
    {ARV_PIXEL_FORMAT_BAYER_RG_8, "u8", 1},   {ARV_PIXEL_FORMAT_BAYER_GR_8, "u8", 1},
    {ARV_PIXEL_FORMAT_BAYER_GB_8, "u8", 1},   {ARV_PIXEL_FORMAT_BAYER_BG_8, "u8", 1},
    {ARV_PIXEL_FORMAT_BAYER_RG_10, "u10", 2}, {ARV_PIXEL_FORMAT_BAYER_GR_10, "u10", 2},
    {ARV_PIXEL_FORMAT_BAYER_GB_10, "u10", 2}, {ARV_PIXEL_FORMAT_BAYER_BG_10, "u10", 2},
    {ARV_PIXEL_FORMAT_BAYER_RG_12, "u12", 2}, {ARV_PIXEL_FORMAT_BAYER_GR_12, "u12", 2},
    {ARV_PIXEL_FORMAT_BAYER_GB_12, "u12", 2}, {ARV_PIXEL_FORMAT_BAYER_BG_12, "u12", 2},
    {ARV_PIXEL_FORMAT_BAYER_RG_16, "u16", 2}, {ARV_PIXEL_FORMAT_BAYER_GR_16, "u16", 2},
    {ARV_PIXEL_FORMAT_BAYER_GB_16, "u16", 2}, {ARV_PIXEL_FORMAT_BAYER_BG_16, "u16", 2},
};

static volatile sig_atomic_t stopped;

static void stop(int number)
{
    stopped = number;
}

static int fail(GError *error)
{
    fprintf(stderr, "hadalens-aravis: %s\n", error->message);
    g_error_free(error);
    return EXIT_FAILURE;
}

static int tell_none(void)
{
    fprintf(stderr, "hadalens-aravis: no camera was found: look at its power, its cable, and, of GigE cameras, at its "
                    "address; USB3 cameras may need a rule of udev (aravis has one)\n");
    return EXIT_FAILURE;
}

static int list_cameras(unsigned count)
{
    for (unsigned i = 0; i < count; i++)
        printf("%s (%s %s)\n", arv_get_device_id(i), arv_get_device_vendor(i), arv_get_device_model(i));
    return EXIT_SUCCESS;
}

/* What is asked for; what is not stays as the camera has it. */
static void set_up(ArvCamera *camera, const settings *set, GError **error)
{
    if (set->pixels)
        arv_camera_set_pixel_format_from_string(camera, set->pixels, error);
    if (!*error && set->exposure_ms > 0.0)
        arv_camera_set_exposure_time(camera, 1000.0 * set->exposure_ms, error);
    if (!*error && set->gain_db >= 0.0)
        arv_camera_set_gain(camera, set->gain_db, error);
    if (!*error && set->rate > 0.0)
        arv_camera_set_frame_rate(camera, set->rate, error);
}

/* The size of the frames and the index of their pixels in `known`. */
static int look(ArvCamera *camera, int *rows, int *cols, GError **error)
{
    const ArvPixelFormat format = arv_camera_get_pixel_format(camera, error);
    if (!*error)
        arv_camera_get_region(camera, NULL, NULL, cols, rows, error);
    for (int i = 0; !*error && i < (int)G_N_ELEMENTS(known); i++)
        if (known[i].format == format)
            return i;
    if (*error)
        return -1;
    const char *name = arv_camera_get_pixel_format_as_string(camera, NULL);
    g_set_error(
        error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
        "pixels of the kind %s cannot be handed on; choose another with --pixels, such as Mono8, Mono16 or BayerRG12",
        name ? name : "that the camera sends");
    return -1;
}

static int write_all(const char *data, size_t bytes)
{
    while (bytes) {
        const ssize_t done = write(STDOUT_FILENO, data, bytes);
        if (done < 0 && errno == EINTR && !stopped)
            continue;
        if (done <= 0)
            return -1;
        data += done;
        bytes -= (size_t)done;
    }
    return 0;
}

/* Writes frames until there are enough, somebody stops, or nobody reads. */
static int hand_on(ArvStream *stream, size_t bytes, int count)
{
    const struct sigaction stops = {.sa_handler = stop}, ignored = {.sa_handler = SIG_IGN};
    long good = 0, bad = 0;
    int code = EXIT_SUCCESS;
    sigaction(SIGINT, &stops, NULL); /* until now they end the program */
    sigaction(SIGTERM, &stops, NULL);
    sigaction(SIGPIPE, &ignored, NULL);
    while (!stopped && (!count || good < count)) {
        ArvBuffer *buffer = arv_stream_timeout_pop_buffer(stream, MICROSECONDS);
        size_t size = 0;
        if (!buffer)
            continue;
        const char *data = arv_buffer_get_data(buffer, &size);
        if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS || size < bytes) {
            bad++;
        } else if (write_all(data, bytes)) {
            code = stopped || errno == EPIPE ? EXIT_SUCCESS : EXIT_FAILURE;
            if (code)
                perror("hadalens-aravis: standard output");
            arv_stream_push_buffer(stream, buffer);
            break;
        } else {
            good++;
        }
        arv_stream_push_buffer(stream, buffer);
    }
    if (bad)
        fprintf(stderr, "hadalens-aravis: %ld of %ld frames were not whole and were left out\n", bad, good + bad);
    return code;
}

static int stream_frames(ArvCamera *camera, size_t bytes, int count, GError **error)
{
    ArvStream *stream = arv_camera_create_stream(camera, NULL, NULL, error);
    const guint payload = *error ? 0 : arv_camera_get_payload(camera, error);
    int code = EXIT_FAILURE;
    for (int i = 0; !*error && i < BUFFERS; i++)
        arv_stream_push_buffer(stream, arv_buffer_new(payload, NULL));
    if (!*error)
        arv_camera_start_acquisition(camera, error);
    if (!*error) {
        code = hand_on(stream, bytes, count);
        arv_camera_stop_acquisition(camera, NULL);
    }
    g_clear_object(&stream);
    return code;
}

static int run(const settings *set)
{
    GError *error = NULL;
    int rows = 0, cols = 0, at = -1, code = EXIT_FAILURE;
    if (set->fake)
        arv_enable_interface("Fake");
    arv_update_device_list();
    const unsigned count = arv_get_n_devices();
    if (!count)
        return tell_none();
    if (set->list)
        return list_cameras(count);
    ArvCamera *camera = arv_camera_new(set->camera ? set->camera : arv_get_device_id(0), &error);
    if (!error)
        set_up(camera, set, &error);
    if (!error)
        at = look(camera, &rows, &cols, &error);
    if (!error && set->describe) {
        printf("%dx%d:%s\n", rows, cols, known[at].name);
        code = EXIT_SUCCESS;
    } else if (!error && isatty(STDOUT_FILENO)) {
        fprintf(stderr,
                "hadalens-aravis: frames are not for a terminal; pipe them to 'hadalens reconstruct --watch - "
                "--headerless %dx%d:%s'\n",
                rows, cols, known[at].name);
    } else if (!error) {
        code = stream_frames(camera, (size_t)rows * (size_t)cols * known[at].bytes, set->count, &error);
    }
    g_clear_object(&camera);
    return error ? fail(error) : code;
}

int main(int argc, char **argv)
{
    settings set = {.gain_db = -1.0};
    GError *error = NULL;
    const GOptionEntry entries[] = {
        {"list", 'l', 0, G_OPTION_ARG_NONE, &set.list, "list the cameras", NULL},
        {"camera", 'c', 0, G_OPTION_ARG_STRING, &set.camera, "the camera's name as --list has it (default: the first)",
         "NAME"},
        {"describe", 'd', 0, G_OPTION_ARG_NONE, &set.describe, "print what --headerless needs to know, and no frame",
         NULL},
        {"pixels", 'p', 0, G_OPTION_ARG_STRING, &set.pixels, "kind of pixels, such as Mono8, Mono16 or BayerRG12",
         "KIND"},
        {"exposure", 'e', 0, G_OPTION_ARG_DOUBLE, &set.exposure_ms, "exposure in milliseconds", "MS"},
        {"gain", 'g', 0, G_OPTION_ARG_DOUBLE, &set.gain_db, "gain in decibels", "DB"},
        {"rate", 'r', 0, G_OPTION_ARG_DOUBLE, &set.rate, "frames per second", "N"},
        {"count", 'n', 0, G_OPTION_ARG_INT, &set.count, "end after N frames (default: Ctrl-C)", "N"},
        {"fake", 0, 0, G_OPTION_ARG_NONE, &set.fake, "also offer Aravis' simulated camera, for trying", NULL},
        {0},
    };
    GOptionContext *options = g_option_context_new("- frames of a GenICam camera for hadalens reconstruct --watch -");
    g_option_context_set_description(
        options,
        "Example:\n  hadalens-aravis | hadalens reconstruct --watch - --headerless \"$(hadalens-aravis --describe)\" "
        "-m camera.model -o results\n");
    g_option_context_add_main_entries(options, entries, NULL);
    const int read = g_option_context_parse(options, &argc, &argv, &error);
    g_option_context_free(options);
    if (!read) {
        fail(error);
        return 2;
    }
    const int code = run(&set);
    g_free(set.camera);
    g_free(set.pixels);
    arv_shutdown();
    return code;
}
