/* The kernels of wave optics. */
#include "optics/wave.h"
#include "runtime/kernel.h"

/* Items along each axis, in work-groups that suit the shape of the device: of one item, or 8 x 8. */
static hada_status launch(hada_slot *slot, const char *file, const char *name, const size_t items[3],
                          const hada_arg *args, size_t count, hada_error *err)
{
    const size_t side = slot->context->shape == HADA_SHAPE_GROUPS ? 8 : 1, local[3] = {side, side, 1};
    size_t global[3];
    for (int i = 0; i < 3; i++)
        global[i] = (items[i] + local[i] - 1) / local[i] * local[i];
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(slot, file, name, "", &kernel, err);
    return status ? status : hada_slot_launch(slot, kernel, name, 3, global, local, args, count, err);
}

hada_status hada_wave_launch_pupil(hada_slot *slot, cl_mem field, cl_mem phase, cl_mem lenses, cl_mem planes, int first,
                                   int count, const hada_wave_spot *spot, double radius, double aperture,
                                   hada_error *err)
{
    const float step = (float)spot->step, lens = (float)radius, whole = (float)aperture;
    /* an item has a row, or every eighth piece of it */
    const size_t pieces = slot->context->shape == HADA_SHAPE_GROUPS ? 8 : 1;
    const size_t items[3] = {pieces, (size_t)spot->points, (size_t)count};
    const hada_arg args[] = {HADA_ARG(field), HADA_ARG(phase),        HADA_ARG(lenses),      HADA_ARG(planes),
                             HADA_ARG(first), HADA_ARG(spot->points), HADA_ARG(spot->pitch), HADA_ARG(step),
                             HADA_ARG(lens),  HADA_ARG(whole)};
    const double values = (double)count * spot->points * spot->pitch;
    hada_slot_cost(slot, 8.0 * values, 30.0 * values);
    return launch(slot, "optics_wave_lens", "optics_wave_pupil", items, args, HADA_COUNT(args), err);
}

hada_status hada_wave_launch_spots(hada_slot *slot, cl_mem image, cl_mem part, cl_mem spectra, int count, int pixels,
                                   int samples, hada_error *err)
{
    const int blocks = (pixels * samples / 2 + HADA_WAVE_BLOCK) / HADA_WAVE_BLOCK;
    const size_t down[3] = {(size_t)blocks, (size_t)pixels, (size_t)count};
    const size_t across[3] = {(size_t)pixels, (size_t)pixels, (size_t)count};
    const hada_arg first[] = {HADA_ARG(part), HADA_ARG(spectra), HADA_ARG(pixels), HADA_ARG(samples), HADA_ARG(blocks)};
    const hada_arg second[] = {HADA_ARG(image), HADA_ARG(part), HADA_ARG(pixels), HADA_ARG(samples), HADA_ARG(blocks)};
    const double values = 8.0 * count * blocks * (double)pixels * samples;
    hada_slot_cost(slot, 16.0 * values, 12.0 * values);
    hada_status status = launch(slot, "optics_wave_lens", "optics_wave_spot_rows", down, first, HADA_COUNT(first), err);
    if (status)
        return status;
    hada_slot_cost(slot, 64.0 * count * blocks * (double)pixels, 16.0 * count * blocks * (double)pixels);
    return launch(slot, "optics_wave_lens", "optics_wave_spot_cols", across, second, HADA_COUNT(second), err);
}

hada_status hada_wave_launch_mask(hada_slot *slot, cl_mem field, cl_mem path, cl_mem open, int n, double waves,
                                  hada_error *err)
{
    const float turns = (float)waves;
    const size_t items[3] = {((size_t)n + 7) / 8, (size_t)n, 1};
    const hada_arg args[] = {HADA_ARG(field), HADA_ARG(path), HADA_ARG(open), HADA_ARG(n), HADA_ARG(turns)};
    hada_slot_cost(slot, 16.0 * n * (double)n, 40.0 * n * (double)n);
    return launch(slot, "optics_wave_whole", "optics_wave_mask", items, args, HADA_COUNT(args), err);
}

hada_status hada_wave_launch_travel(hada_slot *slot, cl_mem spectrum, cl_mem across, cl_mem down, int rows, int blocks,
                                    hada_error *err)
{
    const size_t items[3] = {(size_t)rows, (size_t)blocks, 1};
    const hada_arg args[] = {HADA_ARG(spectrum), HADA_ARG(across), HADA_ARG(down), HADA_ARG(rows), HADA_ARG(blocks)};
    const double values = (double)HADA_WAVE_BLOCK * rows * blocks;
    hada_slot_cost(slot, 32.0 * values, 22.0 * values);
    return launch(slot, "optics_wave_whole", "optics_wave_travel", items, args, HADA_COUNT(args), err);
}

hada_status hada_wave_launch_sensor(hada_slot *slot, cl_mem image, cl_mem part, cl_mem field, cl_mem across,
                                    cl_mem down, int rows, int cols, int pixel_rows, int pixel_cols, hada_error *err)
{
    const size_t over[3] = {(size_t)pixel_cols, (size_t)rows, 1};
    const size_t along[3] = {(size_t)pixel_cols, (size_t)pixel_rows, 1};
    const hada_arg first[] = {HADA_ARG(part), HADA_ARG(field), HADA_ARG(across),
                              HADA_ARG(rows), HADA_ARG(cols),  HADA_ARG(pixel_cols)};
    const hada_arg second[] = {HADA_ARG(image), HADA_ARG(part), HADA_ARG(down), HADA_ARG(pixel_cols),
                               HADA_ARG(pixel_rows)};
    hada_slot_cost(slot, 8.0 * rows * (double)cols, 6.0 * rows * (double)cols);
    hada_status status =
        launch(slot, "optics_wave_whole", "optics_wave_sensor_rows", over, first, HADA_COUNT(first), err);
    if (status)
        return status;
    hada_slot_cost(slot, 4.0 * rows * (double)pixel_cols, 2.0 * rows * (double)pixel_cols);
    return launch(slot, "optics_wave_whole", "optics_wave_sensor_cols", along, second, HADA_COUNT(second), err);
}
