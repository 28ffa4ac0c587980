/* Makes the odd files of the tests.
 *   frame_tool nan IN OUT N          copy of IN's first frame with N pixels made NaN
 *   frame_tool pages IN OUT N        N pages, each IN's first frame
 *   frame_tool flat OUT H W CHANNELS VALUE
 *   frame_tool spots OUT H W COUNT SEED [WHITE]   a PSF: spots on a background of 0.1, noise of 0.001
 *   frame_tool offset IN OUT LEVEL   every page of IN plus LEVEL
 *   frame_tool enhance MODEL OUT     the model with a net (preset compact, random weights)
 *   frame_tool encode IN OUT         IN's first frame in sRGB and 8 bits, which OUT does not say; OUT.rgb: bytes alone
 *   frame_tool net OUT CHANNELS      a U-net of a few weights
 *   frame_tool lpips OUT             AlexNet and the heads of LPIPS, random weights
 *   frame_tool turn IN OUT MAGNIFICATION DEGREES QUARTERS MIRRORED ROWS COLS [PERSPECTIVE]
 *                                    as hada_register_apply(), moved by ROWS and COLS
 *   frame_tool same ONE OTHER        exit code 1 where texts, but for made_from=, or pixels differ
 *   frame_tool info IN               "frames channels rows cols bits", and the mean of the finite values */
#define _GNU_SOURCE /* strdup() */
#include <hadalens/hadalens.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static hada_status save_pages(const char *in, const char *out, int pages, double offset, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_tiff_writer *writer = NULL;
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    hada_status status = hada_tiff_open(&reader, in, err);
    int have = status ? 0 : hada_tiff_get_info(reader)->frames;
    int count = pages ? pages : have;
    for (int t = 0; !status && t < count; t++) {
        hada_image image = {0};
        status = hada_tiff_read(reader, pages ? 0 : t, &image, err);
        if (!status && !writer)
            status = hada_tiff_create(&writer, out, image.channels, image.rows, image.cols, &options, err);
        for (size_t i = 0; !status && i < hada_image_count(&image); i++)
            image.data[i] += (float)offset;
        if (!status)
            status = hada_tiff_write(writer, &image, err);
        hada_image_destroy(&image);
    }
    if (!status)
        status = hada_tiff_finish(&writer, err);
    if (writer)
        hada_tiff_abandon(&writer);
    if (reader)
        hada_tiff_close(&reader);
    return status;
}

static hada_status save_encoded(const char *in, const char *out, hada_error *err)
{
    hada_image image = {0};
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    options.bits = 8;
    hada_status status = hada_tiff_load(in, 0, &image, err);
    const size_t count = status ? 0 : hada_image_count(&image);
    FILE *bytes = !status && strstr(out, ".rgb") ? fopen(out, "wb") : NULL;
    hada_response_convert(image.data, count, HADA_RESPONSE_LINEAR, HADA_RESPONSE_SRGB);
    for (size_t i = 0; bytes && i < count; i++) {
        const size_t channels = (size_t)image.channels;
        const float value = image.data[i % channels * (count / channels) + i / channels];
        fputc((int)(fminf(value, 1.0f) * 255.0f + 0.5f), bytes);
    }
    if (!status && !bytes)
        status = hada_tiff_save(out, &image, &options, err);
    if (bytes)
        fclose(bytes);
    hada_image_destroy(&image);
    return status;
}

static hada_status save_broken(const char *in, const char *out, int count, hada_error *err)
{
    hada_image image = {0};
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    hada_status status = hada_tiff_load(in, 0, &image, err);
    for (int i = 0; !status && i < count; i++)
        image.data[(size_t)i * 37 % hada_image_count(&image)] = NAN;
    if (!status)
        status = hada_tiff_save(out, &image, &options, err);
    hada_image_destroy(&image);
    return status;
}

static hada_status save_flat(char **argv, hada_error *err)
{
    hada_image image = {0};
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    hada_status status = hada_image_create(&image, atoi(argv[5]), atoi(argv[3]), atoi(argv[4]), err);
    for (size_t i = 0; !status && i < hada_image_count(&image); i++)
        image.data[i] = (float)atof(argv[6]);
    if (!status)
        status = hada_tiff_save(argv[2], &image, &options, err);
    hada_image_destroy(&image);
    return status;
}

static double next_random(unsigned long *state)
{
    *state = *state * 6364136223846793005UL + 1442695040888963407UL;
    return (double)(*state >> 33) / 2147483648.0;
}

static hada_status save_spots(char **argv, double white, hada_error *err)
{
    const int rows = atoi(argv[3]), cols = atoi(argv[4]);
    unsigned long state = strtoul(argv[6], NULL, 10);
    hada_image image = {0};
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    hada_status status = hada_image_create(&image, 1, rows, cols, err);
    for (int i = 0; !status && i < rows * cols; i++) {
        double normal = -6.0;
        for (int k = 0; k < 12; k++)
            normal += next_random(&state);
        image.data[i] = (float)(0.1 + 0.001 * normal);
    }
    for (int s = 0; !status && s < atoi(argv[5]); s++) {
        const double y = rows * (0.2 + 0.6 * next_random(&state)), x = cols * (0.2 + 0.6 * next_random(&state));
        for (int i = 0; i < rows * cols; i++)
            image.data[i] += (float)(0.8 * exp(-(pow(i / cols - y, 2) + pow(i % cols - x, 2)) / 2.0));
    }
    for (int i = 0; !status && i < rows * cols; i++)
        image.data[i] = fminf(image.data[i], (float)white);
    if (!status)
        status = hada_tiff_save(argv[2], &image, &options, err);
    hada_image_destroy(&image);
    return status;
}

static hada_status print_info(const char *in, hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = hada_tiff_open(&reader, in, err);
    double sum = 0;
    long count = 0;
    if (status)
        return status;
    const hada_tiff_info info = *hada_tiff_get_info(reader);
    for (int t = 0; !status && t < info.frames; t++) {
        hada_image image = {0};
        status = hada_tiff_read(reader, t, &image, err);
        for (size_t i = 0; !status && i < hada_image_count(&image); i++)
            if (isfinite(image.data[i])) {
                sum += (double)image.data[i];
                count++;
            }
        hada_image_destroy(&image);
    }
    hada_tiff_close(&reader);
    printf("%d %d %d %d %d\n%.6f\n", info.frames, info.channels, info.rows, info.cols, info.bits,
           sum / (double)(count ? count : 1));
    return status;
}

static hada_status save_enhanced(const char *in, const char *out, hada_error *err)
{
    hada_model *model = NULL, *with = NULL;
    hada_net *net = NULL;
    hada_status status = hada_model_load(&model, in, err);
    if (!status)
        status = hada_net_create_preset(&net, "compact", hada_model_get_info(model)->channels, 1, err);
    if (!status)
        status = hada_model_with_enhance(&with, model, net, 0, 0, err);
    if (!status)
        status = hada_model_save(with, out, err);
    hada_net_destroy(&net);
    hada_model_destroy(&with);
    hada_model_destroy(&model);
    return status;
}

static hada_status save_net(const char *out, int channels, hada_error *err)
{
    hada_unet_options options;
    hada_net *net = NULL;
    hada_unet_options_init(&options);
    options.channels = options.out_channels = channels;
    options.down = "4|8";
    options.up = "4";
    hada_status status = hada_net_create_unet(&net, &options, 1, err);
    if (!status)
        status = hada_net_save(net, out, err);
    hada_net_destroy(&net);
    return status;
}

static hada_status save_turned(char **argv, double perspective, hada_error *err)
{
    const hada_registration by = {.size = sizeof(hada_registration),
                                  .magnification = atof(argv[4]),
                                  .rotation_deg = atof(argv[5]),
                                  .quarter_turns = atoi(argv[6]),
                                  .mirrored = atoi(argv[7]),
                                  .offset_row = atof(argv[8]),
                                  .offset_col = atof(argv[9]),
                                  .perspective_col = perspective};
    hada_image image = {0}, out = {0};
    hada_tiff_write_options options;
    int rows, cols;
    hada_tiff_write_options_init(&options);
    hada_status status = hada_tiff_load(argv[2], 0, &image, err);
    hada_register_size(&by, image.rows, image.cols, &rows, &cols);
    if (!status)
        status = hada_register_apply(&out, &image, &by, rows, cols, err);
    if (!status)
        status = hada_tiff_save(argv[3], &out, &options, err);
    hada_image_destroy(&image);
    hada_image_destroy(&out);
    return status;
}

/* A net whose file holds what LPIPS looks for. */
static hada_status save_lpips(const char *out, hada_error *err)
{
    static const char list[] =
        "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 3},"
        "{\"layer\": \"conv\", \"name\": \"features.0\", \"channels\": 64, \"kernel\": 11},"
        "{\"layer\": \"conv\", \"name\": \"features.3\", \"channels\": 192, \"kernel\": 5},"
        "{\"layer\": \"conv\", \"name\": \"features.6\", \"channels\": 384},"
        "{\"layer\": \"conv\", \"name\": \"features.8\", \"channels\": 256},"
        "{\"layer\": \"conv\", \"name\": \"features.10\", \"channels\": 256},"
        "{\"layer\": \"conv\", \"name\": \"lin0.model.1\", \"from\": [1], \"channels\": 1, \"kernel\": 1, \"pad\": 0},"
        "{\"layer\": \"conv\", \"name\": \"lin1.model.1\", \"from\": [2], \"channels\": 1, \"kernel\": 1, \"pad\": 0},"
        "{\"layer\": \"conv\", \"name\": \"lin2.model.1\", \"from\": [3], \"channels\": 1, \"kernel\": 1, \"pad\": 0},"
        "{\"layer\": \"conv\", \"name\": \"lin3.model.1\", \"from\": [4], \"channels\": 1, \"kernel\": 1, \"pad\": 0},"
        "{\"layer\": \"conv\", \"name\": \"lin4.model.1\", \"from\": [5], \"channels\": 1, \"kernel\": 1, \"pad\": 0},"
        "{\"layer\": \"concat\", \"from\": [6, 7, 8, 9, 10]}]}";
    hada_net *net = NULL;
    hada_status status = hada_net_create(&net, list, 1, err);
    if (!status)
        status = hada_net_save(net, out, err);
    hada_net_destroy(&net);
    return status;
}

/* Without the line that names what a result is made from. */
static void take_out(char *text)
{
    char *line = strstr(text, "made_from="), *end = line ? strchr(line, '\n') : NULL;
    if (end)
        memmove(line, end + 1, strlen(end));
}

static int same_texts(const hada_tiff_info *a, const hada_tiff_info *b)
{
    char *one = strdup(a->description), *other = strdup(b->description);
    take_out(one);
    take_out(other);
    const int same = !strcmp(one, other);
    free(one);
    free(other);
    return same && a->frames == b->frames && a->bits == b->bits && a->slices == b->slices;
}

static int same(const char *one, const char *other)
{
    hada_tiff_reader *a = NULL, *b = NULL;
    int equal = !hada_tiff_open(&a, one, NULL) && !hada_tiff_open(&b, other, NULL) &&
                same_texts(hada_tiff_get_info(a), hada_tiff_get_info(b));
    for (int i = 0; equal && i < hada_tiff_get_info(a)->frames; i++) {
        hada_image x = {0}, y = {0};
        equal = !hada_tiff_read(a, i, &x, NULL) && !hada_tiff_read(b, i, &y, NULL) && x.channels == y.channels &&
                x.rows == y.rows && x.cols == y.cols && !memcmp(x.data, y.data, hada_image_count(&x) * sizeof(float));
        hada_image_destroy(&x);
        hada_image_destroy(&y);
    }
    hada_tiff_close(&a);
    hada_tiff_close(&b);
    return equal;
}

int main(int argc, char **argv)
{
    hada_error err = {0};
    hada_status status = HADA_ERROR_ARGUMENT;
    const char *what = argc > 1 ? argv[1] : "";
    if (!strcmp(what, "same") && argc == 4)
        return !same(argv[2], argv[3]);
    snprintf(err.message, sizeof err.message, "frame_tool: see the head of frame_tool.c");
    if (!strcmp(what, "nan") && argc == 5)
        status = save_broken(argv[2], argv[3], atoi(argv[4]), &err);
    else if (!strcmp(what, "pages") && argc == 5)
        status = save_pages(argv[2], argv[3], atoi(argv[4]), 0, &err);
    else if (!strcmp(what, "offset") && argc == 5)
        status = save_pages(argv[2], argv[3], 0, atof(argv[4]), &err);
    else if (!strcmp(what, "encode") && argc == 4)
        status = save_encoded(argv[2], argv[3], &err);
    else if (!strcmp(what, "net") && argc == 4)
        status = save_net(argv[2], atoi(argv[3]), &err);
    else if (!strcmp(what, "flat") && argc == 7)
        status = save_flat(argv, &err);
    else if (!strcmp(what, "spots") && (argc == 7 || argc == 8))
        status = save_spots(argv, argc == 8 ? atof(argv[7]) : INFINITY, &err);
    else if (!strcmp(what, "enhance") && argc == 4)
        status = save_enhanced(argv[2], argv[3], &err);
    else if (!strcmp(what, "lpips") && argc == 3)
        status = save_lpips(argv[2], &err);
    else if (!strcmp(what, "turn") && (argc == 10 || argc == 11))
        status = save_turned(argv, argc == 11 ? atof(argv[10]) : 0.0, &err);
    else if (!strcmp(what, "info") && argc == 3)
        status = print_info(argv[2], &err);
    if (status)
        fprintf(stderr, "%s\n", err.message);
    return status ? 1 : 0;
}
