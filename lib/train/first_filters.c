#include "train/first_filters.h"

#include <stdlib.h>

#include "core/alloc.h"
#include "core/random.h"
#include "filter/bank.h"
#include "io/safetensors.h"

/* Of the real and imaginary parts of a random start. */
#define START_DEVIATION 0.05

/* A filter of normal numbers, row-major. The columns that stand for themselves hold both signs of a frequency: there
 * the filter of a real kernel is conj-symmetric (complex), and both its parts are even (split). */
static void random_filter(const hada_spectrum_layout *layout, int split, hada_random *random, float *filter)
{
    const int cols = layout->cols / 2 + 1;
    for (size_t i = 0; i < 2 * (size_t)layout->rows * (size_t)cols; i++)
        filter[i] = (float)(START_DEVIATION * hada_random_normal(random));
    for (int kx = 0; kx < cols; kx++) {
        if (kx && 2 * kx != layout->cols)
            continue;
        for (int ky = 0; ky < layout->rows; ky++) {
            const int other = ky ? layout->rows - ky : 0;
            const size_t to = 2 * ((size_t)ky * (size_t)cols + (size_t)kx);
            const size_t from = 2 * ((size_t)other * (size_t)cols + (size_t)kx);
            if (other > ky)
                continue;
            filter[to] = filter[from];
            filter[to + 1] = split ? filter[from + 1] : other == ky ? 0.0f : -filter[from + 1];
        }
    }
}

static void take_filter(const hada_model *model, size_t first, size_t count, float *filter)
{
    for (size_t i = 0; i < count; i++)
        filter[i] = model->filter ? model->filter[first + i] : hada_float_from_half(model->filter_half[first + i]);
}

hada_status hada_first_filters(const hada_replica_shape *shape, const hada_replica_desc *desc, int depth, float *values,
                               hada_error *err)
{
    const hada_spectrum_layout *layout = &shape->layout;
    const size_t channels = (size_t)shape->channels, plane = hada_model_plane(desc->model);
    const int drawn = shape->stage == HADA_STAGE_FILTERS && desc->options->random_start;
    float *filter = NULL;
    hada_random random;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_allocated(filter = hada_alloc(2 * plane, sizeof *filter, "a filter", err)));
    hada_random_seed(&random, desc->options->seed, (uint64_t)depth);
    for (size_t c = 0; c < channels; c++) {
        const size_t first = ((size_t)depth * channels + c) * 2 * plane;
        if (drawn)
            random_filter(layout, shape->form == HADA_FORM_SPLIT, &random, filter);
        else
            take_filter(desc->model, first, 2 * plane, filter);
        hada_layout_pack(layout, filter, values + 2 * c * layout->count);
    }
done:
    free(filter);
    return status;
}
