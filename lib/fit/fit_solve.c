#include "fit/fit_solve.h"

hada_status hada_fit_solve_filter(const hada_fit_sums *sums, int channel, double alpha, double ridge, cl_mem out,
                                  size_t at, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const cl_ulong stride = grid->stride, vectors = grid->vectors, offset = at;
    const cl_float weight = (cl_float)alpha, added = (cl_float)ridge;
    const hada_arg args[] = {HADA_ARG(sums->sums[channel].mem),
                             HADA_ARG(sums->pool[channel].mem),
                             HADA_ARG(stride),
                             HADA_ARG(weight),
                             HADA_ARG(added),
                             HADA_ARG(out),
                             HADA_ARG(offset),
                             HADA_ARG(vectors)};
    hada_slot_cost(grid->slot, (hada_fit_is_split(grid) ? 384.0 : 192.0) * (double)vectors, 40.0 * (double)vectors);
    return hada_fit_launch(grid, "fit_solve", "fit_filter", args, HADA_COUNT(args), err);
}

/* From the pairs alone. */
static hada_status free_transfer(const hada_fit_sums *sums, int channel, double scene_energy, cl_mem out, size_t at,
                                 hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const cl_ulong stride = grid->stride, vectors = grid->vectors, offset = at;
    const cl_float least = (cl_float)(HADA_FIT_LEAST_SCENE * scene_energy);
    const hada_arg args[] = {HADA_ARG(sums->sums[channel].mem),
                             HADA_ARG(stride),
                             HADA_ARG(least),
                             HADA_ARG(out),
                             HADA_ARG(offset),
                             HADA_ARG(vectors)};
    hada_slot_cost(grid->slot, 160.0 * (double)vectors, 24.0 * (double)vectors);
    return hada_fit_launch(grid, "fit_solve", "fit_transfer", args, HADA_COUNT(args), err);
}

hada_status hada_fit_solve_transfers(const hada_fit_sums *sums, hada_nonnegative *nonnegative,
                                     const double *scene_energy, const double *trust, cl_mem out, size_t at,
                                     hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    hada_nonnegative_rule rule;
    hada_status status = HADA_OK;
    hada_nonnegative_rule_init(&rule);
    if (nonnegative)
        return hada_nonnegative_solve(nonnegative, &rule, grid->info.channels, sums->sums, grid->stride, scene_energy,
                                      trust, out, at, err);
    for (int c = 0; c < grid->info.channels; c++)
        HADA_TRY(free_transfer(sums, c, scene_energy[c], out, at + (size_t)c * grid->layout.count, err));
done:
    return status;
}

hada_status hada_fit_unexplained(const hada_fit_sums *sums, int channel, double scene_energy,
                                 const hada_buffer *partial, float *values, double *sum, hada_error *err)
{
    const hada_fit_grid *grid = sums->grid;
    const cl_ulong stride = grid->stride, vectors = grid->vectors;
    const cl_float least = (cl_float)(HADA_FIT_LEAST_SCENE * scene_energy);
    const cl_int chunks = (cl_int)grid->chunks;
    const hada_arg args[] = {HADA_ARG(sums->sums[channel].mem),
                             HADA_ARG(stride),
                             HADA_ARG(sums->weights.mem),
                             HADA_ARG(least),
                             HADA_ARG(partial->mem),
                             HADA_ARG(chunks),
                             HADA_ARG(vectors)};
    hada_status status = HADA_OK;
    *sum = 0.0;
    hada_slot_cost(grid->slot, 160.0 * (double)vectors, 64.0 * (double)vectors);
    HADA_TRY(hada_fit_launch_chunks(grid, "fit_score", "fit_unexplained", args, HADA_COUNT(args), err));
    HADA_TRY(hada_buffer_read(partial, grid->slot, 0, values, grid->chunks * sizeof *values, err));
    for (size_t i = 0; i < grid->chunks; i++)
        *sum += values[i];
done:
    return status;
}
