#include "fit/fit_solve.h"

#include "launch/fit_score.h"
#include "launch/fit_solve.h"

static hada_program_fit_solve program_of(const hada_fit_grid *grid)
{
    return hada_fit_is_split(grid) ? HADA_PROGRAM_FIT_SOLVE_SPLIT : HADA_PROGRAM_FIT_SOLVE_DEFAULT;
}

hada_fit_penalty hada_fit_penalty_of(hada_fit_setting setting, double raw_energy)
{
    return (hada_fit_penalty){(float)setting.alpha, (float)(setting.lambda * raw_energy)};
}

hada_status hada_fit_solve_filter(const hada_fit_sums *sums, int channel, hada_fit_penalty penalty, cl_mem out,
                                  size_t n, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_vectors(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    hada_slot_cost(grid->slot, (hada_fit_is_split(grid) ? 48.0 : 24.0) * values, 5.0 * values);
    return hada_launch_fit_filter(grid->slot, program_of(grid), &range, err, .sums = sums->sums[channel].mem,
                                  .pool = sums->pool[channel].mem, .filter = out, .image = hada_fit_image_of(grid, n),
                                  .penalty = penalty);
}

/* From the pairs alone. */
static hada_status free_transfer(const hada_fit_sums *sums, int channel, double scene_energy, cl_mem out, size_t n,
                                 hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_vectors(grid);
    const double values = (double)grid->vectors * HADA_FIT_VECTOR;
    hada_slot_cost(grid->slot, 20.0 * values, 3.0 * values);
    return hada_launch_fit_transfer(grid->slot, program_of(grid), &range, err, .sums = sums->sums[channel].mem,
                                    .otf = out, .image = hada_fit_image_of(grid, n),
                                    .least = (cl_float)(HADA_FIT_LEAST_SCENE * scene_energy));
}

hada_status hada_fit_solve_transfers(const hada_fit_sums *sums, hada_nonnegative *nonnegative,
                                     const double *scene_energy, const double *trust, cl_mem out, size_t n,
                                     hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    hada_nonnegative_rule rule;
    hada_nonnegative_rule_init(&rule);
    if (nonnegative)
        return hada_nonnegative_solve(nonnegative, &rule, grid->info.channels, sums->sums, grid->stride, scene_energy,
                                      trust, out, n * grid->layout.count, err);
    for (int c = 0; c < grid->info.channels; c++)
        HADA_TRY(free_transfer(sums, c, scene_energy[c], out, n + (size_t)c, err));
    return HADA_OK;
}

hada_status hada_fit_unexplained(const hada_fit_sums *sums, int channel, double scene_energy,
                                 const hada_buffer *partial, float *values, double *sum, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const hada_range range = hada_fit_chunks(grid);
    const hada_program_fit_score program =
        HADA_FIT_PROGRAM(FIT_SCORE, hada_fit_is_split(grid), hada_fit_in_groups(grid));
    const double frequencies = (double)grid->vectors * HADA_FIT_VECTOR;
    *sum = 0.0;
    hada_slot_cost(grid->slot, 20.0 * frequencies, 8.0 * frequencies);
    HADA_TRY(hada_launch_fit_unexplained(grid->slot, program, &range, err, .sums = sums->sums[channel].mem,
                                         .weights = sums->weights.mem, .out = partial->mem,
                                         .image = hada_fit_image_of(grid, 0),
                                         .least = (cl_float)(HADA_FIT_LEAST_SCENE * scene_energy)));
    HADA_TRY(hada_buffer_read(partial, grid->slot, 0, values, grid->chunks * sizeof *values, err));
    for (size_t i = 0; i < grid->chunks; i++)
        *sum += values[i];
    return HADA_OK;
}
