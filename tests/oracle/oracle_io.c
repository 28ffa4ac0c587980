/* Reads and writes files for the Python checks beside it.
 *   oracle_io read-tiff FILE OUT.raw       prints "frames channels rows cols slices times"; float32 planes of all
 * frames oracle_io write-tiff FILE BITS LAYOUT CHANNELS ROWS COLS SLICES COMPRESS < planes oracle_io read-tensors FILE
 * prints "name type dims shape... sum" per tensor, "key=value" per metadata asked oracle_io write-tensors FILE a fixed
 * set of tensors
 */
#include <hadalens/tiff.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "helpers.h"
#include "io/safetensors.h"

static int report(hada_status status, const hada_error *err)
{
    if (status)
        fprintf(stderr, "%s: %s\n", hada_status_name(status), err->message);
    return (int)status;
}

static int read_tiff(const char *path, const char *out)
{
    hada_error err = {0};
    hada_tiff_reader *reader;
    hada_status status = hada_tiff_open(&reader, path, &err);
    if (status)
        return report(status, &err);
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    printf("%d %d %d %d %d %d %d %g %g\n", info->frames, info->channels, info->rows, info->cols, info->slices,
           info->times, info->bits, info->pixel_width_um, info->slice_spacing);
    FILE *file = fopen(out, "wb");
    for (int i = 0; file && !status && i < info->frames; i++) {
        SCOPED(hada_image) image;
        status = hada_tiff_read(reader, i, &image, &err);
        if (!status)
            fwrite(image.data, sizeof(float), hada_image_count(&image), file);
    }
    if (file)
        fclose(file);
    hada_tiff_close(&reader);
    return report(status, &err);
}

static int write_tiff(char **args)
{
    hada_tiff_write_options options;
    hada_tiff_write_options_init(&options);
    options.bits = atoi(args[1]);
    options.layout = !strcmp(args[2], "stack") ? HADA_TIFF_HYPERSTACK : HADA_TIFF_PAGES;
    int channels = atoi(args[3]), rows = atoi(args[4]), cols = atoi(args[5]);
    options.slices = atoi(args[6]);
    options.compress = atoi(args[7]);
    double distances[4096];
    for (int i = 0; i < options.slices; i++)
        distances[i] = 100 + 12.5 * i * i;
    options.distances_mm = distances;
    options.pixel_um = 3.5;
    options.description = "model=test\n";
    hada_error err = {0};
    hada_image image;
    hada_tiff_writer *writer = NULL;
    hada_status status = hada_image_create(&image, channels, rows, cols, &err);
    if (!status)
        status = hada_tiff_create(&writer, args[0], channels, rows, cols, &options, &err);
    for (int i = 0; !status && i < options.slices; i++) {
        if (fread(image.data, sizeof(float), hada_image_count(&image), stdin) != hada_image_count(&image))
            status = HADA_ERROR_FILE_READ;
        else
            status = hada_tiff_write(writer, &image, &err);
    }
    if (!status)
        status = hada_tiff_finish(&writer, &err);
    hada_tiff_abandon(&writer);
    hada_image_destroy(&image);
    return report(status, &err);
}

static int read_tensors(const char *path)
{
    hada_error err = {0};
    hada_tensors *tensors;
    hada_status status = hada_tensors_open(&tensors, path, &err);
    if (status)
        return report(status, &err);
    for (size_t i = 0; i < hada_tensors_count(tensors); i++) {
        const hada_stored_tensor *tensor = hada_tensors_at(tensors, i);
        printf("%s %s", tensor->name, hada_dtype_name(tensor->type));
        for (int d = 0; d < tensor->dims; d++)
            printf(" %lld", (long long)tensor->shape[d]);
        size_t count = tensor->bytes / hada_dtype_bytes(tensor->type);
        float *values = calloc(count + 1, sizeof *values);
        if (values && !hada_tensor_copy_f32(tensor, 0, count, values, NULL)) {
            printf(" :");
            for (size_t k = 0; k < count; k++)
                printf(" %a", (double)values[k]);
        }
        free(values);
        printf("\n");
    }
    const char *note = hada_tensors_meta(tensors, "note");
    printf("note=%s\n", note ? note : "");
    hada_tensors_close(&tensors);
    return 0;
}

static int write_tensors(const char *path)
{
    hada_error err = {0};
    hada_tensors_writer *writer;
    hada_status status = hada_tensors_create(&writer, path, &err);
    const int64_t wide[] = {2, 3}, none[] = {0, 4};
    const double doubles[] = {1, -2.5, 1e300, 0, 3, 7};
    const float floats[] = {0.5f, -1e-30f, 3e38f, 4, 5, 6}, scalar = 42;
    const uint16_t halves[6] = {hada_half_from_float(0.1f),  hada_half_from_float(-2),   hada_half_from_float(65504),
                                hada_half_from_float(6e-8f), hada_half_from_float(1e6f), 0};
    if (!status)
        status = hada_tensors_put_meta(writer, "note", "f\xc3\xbcr \"Python\"\n", &err);
    const struct {
        const char *name;
        hada_dtype type;
        int dims;
        const int64_t *shape;
        const void *data;
        size_t bytes;
    } all[] = {{"doubles", HADA_F64, 2, wide, doubles, sizeof doubles},
               {"floats", HADA_F32, 2, wide, floats, sizeof floats},
               {"scalar", HADA_F32, 0, NULL, &scalar, sizeof scalar},
               {"empty", HADA_F32, 2, none, NULL, 0},
               {"halves", HADA_F16, 2, wide, halves, sizeof halves}};
    for (int i = 0; !status && i < 5; i++)
        status = hada_tensors_declare(writer, all[i].name, all[i].type, all[i].dims, all[i].shape, &err);
    for (int i = 0; !status && i < 5; i++)
        if (all[i].bytes)
            status = hada_tensors_write(writer, all[i].data, all[i].bytes, &err);
    if (!status)
        status = hada_tensors_finish(&writer, &err);
    else
        hada_tensors_abandon(&writer);
    return report(status, &err);
}

int main(int count, char **args)
{
    if (count == 4 && !strcmp(args[1], "read-tiff"))
        return read_tiff(args[2], args[3]);
    if (count == 10 && !strcmp(args[1], "write-tiff"))
        return write_tiff(args + 2);
    if (count == 3 && !strcmp(args[1], "read-tensors"))
        return read_tensors(args[2]);
    if (count == 3 && !strcmp(args[1], "write-tensors"))
        return write_tensors(args[2]);
    fprintf(stderr, "see the head of oracle_io.c\n");
    return 2;
}
