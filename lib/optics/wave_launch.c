/* The kernels of wave optics. */
#include "launch/optics_wave_lens.h"
#include "launch/optics_wave_whole.h"
#include "optics/wave.h"

static size_t side_of(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? 8 : 1;
}

/* Items along each axis, in work-groups that suit the shape of the device: of one item, or 8 x 8. */
static hada_range items_of(const hada_slot *slot, size_t across, size_t down, size_t planes)
{
    const size_t side = side_of(slot);
    return (hada_range){{hada_round_up(across, side), hada_round_up(down, side), planes}, {side, side, 1}, 0};
}

hada_status hada_wave_launch_pupil(hada_slot *slot, cl_mem field, cl_mem phase, hada_wave_lens_array lenses,
                                   cl_mem planes, int first, int count, const hada_wave_spot *spot, double radius,
                                   double aperture, hada_error *err)
{
    const hada_optics_field lens_field = {spot->points, spot->pitch, (float)spot->step, (float)radius, (float)aperture};
    /* an item has a row, or every eighth piece of it */
    const hada_range range = items_of(slot, side_of(slot), (size_t)spot->points, (size_t)count);
    const double values = (double)count * spot->points * spot->pitch;
    hada_slot_cost(slot, 8.0 * values, 30.0 * values);
    return hada_launch_optics_wave_pupil(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &range, err, .field = field,
                                         .phase = phase, .lenses = lenses, .planes = planes, .first = first,
                                         .lens_field = lens_field);
}

hada_status hada_wave_launch_spots(hada_slot *slot, cl_mem image, cl_mem part, cl_mem spectra, int count, int pixels,
                                   int samples, hada_error *err)
{
    const int blocks = (pixels * samples / 2 + HADA_FFT_BLOCK) / HADA_FFT_BLOCK;
    const hada_range rows = items_of(slot, (size_t)blocks, (size_t)pixels, (size_t)count);
    const hada_range cols = items_of(slot, (size_t)pixels, (size_t)pixels, (size_t)count);
    const double values = 8.0 * count * blocks * (double)pixels * samples;
    hada_slot_cost(slot, 16.0 * values, 12.0 * values);
    HADA_TRY(hada_launch_optics_wave_spot_rows(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &rows, err, .part = part,
                                               .spectra = spectra, .pixels = pixels, .samples = samples,
                                               .blocks = blocks));
    hada_slot_cost(slot, 64.0 * count * blocks * (double)pixels, 16.0 * count * blocks * (double)pixels);
    return hada_launch_optics_wave_spot_cols(slot, HADA_PROGRAM_OPTICS_WAVE_LENS_DEFAULT, &cols, err, .image = image,
                                             .part = part, .pixels = pixels, .samples = samples, .blocks = blocks);
}

hada_status hada_wave_launch_mask(hada_slot *slot, cl_mem field, cl_mem path, cl_mem open, int n, double waves,
                                  hada_error *err)
{
    const hada_range range = items_of(slot, hada_divide_up((size_t)n, 8), (size_t)n, 1);
    hada_slot_cost(slot, 16.0 * n * (double)n, 40.0 * n * (double)n);
    return hada_launch_optics_wave_mask(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &range, err, .field = field,
                                        .path = path, .open = open, .n = n, .waves = (float)waves);
}

hada_status hada_wave_launch_travel(hada_slot *slot, cl_mem spectrum, cl_mem across, cl_mem down, int rows, int blocks,
                                    hada_error *err)
{
    const hada_range range = items_of(slot, (size_t)rows, (size_t)blocks, 1);
    const double values = (double)HADA_FFT_BLOCK * rows * blocks;
    hada_slot_cost(slot, 32.0 * values, 22.0 * values);
    return hada_launch_optics_wave_travel(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &range, err,
                                          .spectrum = spectrum, .across = across, .down = down, .rows = rows,
                                          .blocks = blocks);
}

hada_status hada_wave_launch_sensor(hada_slot *slot, cl_mem image, cl_mem part, cl_mem field,
                                    hada_wave_pixel_array across, hada_wave_pixel_array down, int rows, int cols,
                                    int pixel_rows, int pixel_cols, hada_error *err)
{
    const hada_range over = items_of(slot, (size_t)pixel_cols, (size_t)rows, 1);
    const hada_range along = items_of(slot, (size_t)pixel_cols, (size_t)pixel_rows, 1);
    hada_slot_cost(slot, 8.0 * rows * (double)cols, 6.0 * rows * (double)cols);
    HADA_TRY(hada_launch_optics_wave_sensor_rows(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &over, err, .part = part,
                                                 .field = field, .table = across, .rows = rows, .cols = cols,
                                                 .pixels = pixel_cols));
    hada_slot_cost(slot, 4.0 * rows * (double)pixel_cols, 2.0 * rows * (double)pixel_cols);
    return hada_launch_optics_wave_sensor_cols(slot, HADA_PROGRAM_OPTICS_WAVE_WHOLE_DEFAULT, &along, err,
                                               .image = image, .part = part, .table = down, .pixels = pixel_cols,
                                               .pixel_rows = pixel_rows);
}
