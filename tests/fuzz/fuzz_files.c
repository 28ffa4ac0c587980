/* Pictures, tensors, models, nets, cameras: files as a whole. */
#include <hadalens/camera.h>
#include <hadalens/headerless.h>
#include <hadalens/model.h>
#include <hadalens/net.h>
#include <hadalens/tiff.h>
#include <stdlib.h>
#include <string.h>

#include "fit/fit_sums.h"
#include "fuzz.h"
#include "io/safetensors.h"
#include "io/tiff_meta.h"

enum { MOST_FRAMES = 3 };

void fuzz_tiff(const uint8_t *data, size_t bytes)
{
    hada_tiff_reader *reader;
    hada_error err = {0};
    double distances[8];
    const hada_status opened = hada_tiff_open(&reader, fuzz_path(data, bytes), &err);
    fuzz_check_file(opened, &err);
    if (opened)
        return;
    for (int i = 0; i < hada_tiff_get_info(reader)->frames && i < MOST_FRAMES; i++) {
        hada_image image;
        const hada_status status = hada_tiff_read(reader, i, &image, &err);
        fuzz_check_file(status, &err);
        if (!status)
            hada_image_destroy(&image);
    }
    hada_tiff_close(&reader);
}

/* The first line says how the frames behind it lie. */
void fuzz_headerless(const uint8_t *data, size_t bytes)
{
    const uint8_t *end = bytes ? memchr(data, '\n', bytes) : NULL;
    const size_t length = end ? (size_t)(end - data) : bytes;
    char *text = fuzz_text(data, length);
    hada_error err = {0};
    const hada_status status = hada_headerless_set(text, &err);
    fuzz_check(status, &err);
    if (!status && end)
        fuzz_tiff(end + 1, bytes - length - 1);
    hada_headerless_set(NULL, NULL);
    free(text);
}

/* The number of pages goes before the text. */
void fuzz_tiff_text(const uint8_t *data, size_t bytes)
{
    hada_tiff_stack stack;
    hada_error err = {0};
    const size_t pages = bytes ? data[0] : 0;
    char *text = fuzz_text(data + (bytes > 0), bytes - (bytes > 0));
    const hada_status status = hada_tiff_stack_parse(&stack, text, pages, &err);
    fuzz_check(status, &err);
    for (int i = 0; !status && stack.pages && i < stack.images; i++)
        if (stack.pages[i] < 0 || stack.pages[i] >= stack.images)
            abort();
    if (!status)
        hada_tiff_stack_free(&stack);
    free(text);
}

void fuzz_safetensors(const uint8_t *data, size_t bytes)
{
    hada_tensors *tensors;
    hada_error err = {0};
    const hada_status opened = hada_tensors_open(&tensors, fuzz_path(data, bytes), &err);
    fuzz_check_file(opened, &err);
    for (size_t i = 0; !opened && i < hada_tensors_count(tensors); i++) {
        const hada_stored_tensor *tensor = hada_tensors_at(tensors, i);
        float few[4];
        const size_t size = hada_dtype_bytes(tensor->type), count = tensor->bytes / size;
        fuzz_check_file(hada_tensor_copy_f32(tensor, count > 4 ? count - 4 : 0, count > 4 ? 4 : count, few, &err),
                        &err);
        if (hada_tensors_find(tensors, tensor->name) != tensor)
            abort();
    }
    if (!opened)
        hada_tensors_close(&tensors);
}

void fuzz_model(const uint8_t *data, size_t bytes)
{
    hada_model *model;
    hada_error err = {0};
    const hada_status status = hada_model_load(&model, fuzz_path(data, bytes), &err);
    fuzz_check_file(status, &err);
    if (!status)
        hada_model_destroy(&model);
}

void fuzz_sums(const uint8_t *data, size_t bytes)
{
    hada_fit_options options;
    hada_error err = {0};
    hada_fit_options_init(&options);
    fuzz_check_file(hada_fit_sums_options(fuzz_path(data, bytes), &options, &err), &err);
}

void fuzz_net(const uint8_t *data, size_t bytes)
{
    hada_net *net;
    hada_error err = {0};
    const hada_status status = hada_net_load(&net, fuzz_path(data, bytes), &err);
    fuzz_check_file(status, &err);
    if (!status)
        hada_net_destroy(&net);
}

void fuzz_camera(const uint8_t *data, size_t bytes)
{
    hada_camera camera = {.size = sizeof camera};
    hada_error err = {0};
    hada_camera_init(&camera);
    fuzz_check_file(hada_camera_load(&camera, fuzz_path(data, bytes), &err), &err);
}
