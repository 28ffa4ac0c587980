/* Losses: value by value, of neighbours, and structural similarity. */
#include "net/loss.h"

#include "launch/net_loss.h"
#include "launch/net_ssim.h"
#include "net/layer_launch.h"

/* Structural similarity as a loss: 1 - its mean. It works on planar copies of the images: few channels stand in a
 * block, so that vectors along the rows do less. */

enum { ROW_ITEMS = 32 }; /* work-items that share a row on GPUs */

/* Constants of the formula, Wang et al. 2004. */
#define K1 0.01
#define K2 0.03

/* In the scratch: planar x and target, five local means (later three gradients), three derivatives, sums. */
typedef struct ssim_places {
    int planes, out_rows;
    hada_ssim_layout at;
} ssim_places;

static ssim_places ssim_places_of(const hada_tensor *x)
{
    const int pitch = (int)hada_round_up((size_t)x->cols, 8) + 16; /* windows of the last vector reach further */
    ssim_places p = {.planes = x->images * x->channels,
                     .out_rows = x->rows - HADA_SSIM_SIZE + 1,
                     .at = {.rows = x->rows, .cols = x->cols, .pitch = pitch}};
    const size_t rows = (size_t)p.planes * (size_t)p.out_rows;
    p.at.target = (size_t)p.planes * (size_t)x->rows * (size_t)pitch;
    p.at.means = 2 * p.at.target;
    p.at.slopes = p.at.means + rows * 5 * (size_t)pitch;
    p.at.sums = p.at.slopes + rows * 3 * (size_t)(pitch + 2 * HADA_SSIM_MARGIN);
    return p;
}

static int ssim_fits(const hada_tensor *x)
{
    return x->rows >= HADA_SSIM_SIZE && x->cols >= HADA_SSIM_SIZE;
}

static size_t ssim_scratch(const hada_tensor *x)
{
    if (!ssim_fits(x))
        return sizeof(float); /* the run will say why not */
    const ssim_places p = ssim_places_of(x);
    const size_t items = (size_t)p.planes * (size_t)p.out_rows * ROW_ITEMS;
    return ((size_t)p.at.sums + items + hada_sum_scratch(items)) * sizeof(float);
}

static size_t row_items(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? ROW_ITEMS : 1;
}

static hada_range ssim_range(const hada_slot *slot, int rows, int planes)
{
    return hada_range_groups(1, row_items(slot), (size_t)rows, (size_t)planes);
}

static hada_status ssim_planar(hada_slot *slot, const hada_tensor *x, const ssim_places *p, size_t offset,
                               cl_mem scratch, hada_error *err)
{
    const size_t plane = (size_t)p->at.rows * (size_t)p->at.pitch;
    const hada_planar to = {scratch, offset, plane * (size_t)x->channels, plane, (size_t)p->at.pitch};
    return hada_tensor_store(slot, x, &to, err);
}

/* The sums of S per work-item, and the derivatives. */
static hada_status ssim_compare(hada_slot *slot, const hada_loss_desc *desc, const ssim_places *p, cl_mem scratch,
                                hada_error *err)
{
    const hada_range range = ssim_range(slot, p->out_rows, p->planes);
    HADA_TRY(
        hada_launch_net_ssim_down(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &range, err, .scratch = scratch, .at = p->at));
    return hada_launch_net_ssim_along(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &range, err, .scratch = scratch, .at = p->at,
                                      .c1 = (cl_float)(K1 * desc->peak * K1 * desc->peak),
                                      .c2 = (cl_float)(K2 * desc->peak * K2 * desc->peak));
}

static hada_status ssim_gradient(hada_slot *slot, const ssim_places *p, float factor, const hada_tensor *dx,
                                 int accumulate, cl_mem scratch, hada_error *err)
{
    const hada_tensor_layout at_dx = hada_layout_of(dx);
    const hada_range along = ssim_range(slot, p->out_rows, p->planes);
    const hada_range down = ssim_range(slot, p->at.rows, dx->images * at_dx.blocks);
    HADA_TRY(hada_launch_net_ssim_back_along(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &along, err, .scratch = scratch,
                                             .at = p->at));
    return hada_launch_net_ssim_back_down(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &down, err, .scratch = scratch,
                                          .at = p->at, .dx = dx->mem, .at_dx = at_dx, .block = dx->block,
                                          .scale = factor, .accumulate = accumulate);
}

static hada_status ssim_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x,
                            const hada_tensor *target, hada_floats value, const hada_tensor *dx, int accumulate,
                            cl_mem scratch, hada_error *err)
{
    if (!ssim_fits(x))
        return hada_fail(err, HADA_ERROR_SIZE, "structural similarity needs images of at least 11 x 11, not %d x %d",
                         x->rows, x->cols);
    if (!(desc->peak > 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", desc->peak);
    const ssim_places p = ssim_places_of(x);
    const size_t windows = (size_t)p.planes * (size_t)p.out_rows * (size_t)(p.at.cols - HADA_SSIM_SIZE + 1);
    const size_t sums = (size_t)p.planes * (size_t)p.out_rows * row_items(slot);
    const float factor = (float)(-(double)desc->weight / (double)windows);
    HADA_TRY(ssim_planar(slot, x, &p, p.at.x, scratch, err));
    HADA_TRY(ssim_planar(slot, target, &p, p.at.target, scratch, err));
    HADA_TRY(ssim_compare(slot, desc, &p, scratch, err));
    HADA_TRY(hada_sum_floats(slot, scratch, (size_t)p.at.sums, sums, factor, desc->weight, value, err));
    if (dx)
        HADA_TRY(ssim_gradient(slot, &p, factor, dx, accumulate, scratch, err));
    return HADA_OK;
}

static double values_of(const hada_tensor *x)
{
    return (double)x->images * x->channels * x->rows * x->cols;
}

size_t hada_loss_scratch(const hada_loss_desc *desc, const hada_tensor *x)
{
    if (desc->loss == HADA_LOSS_SSIM)
        return ssim_scratch(x);
    const size_t sums = hada_layer_sums_at_most(x);
    return (sums + hada_sum_scratch(sums)) * sizeof(float);
}

static hada_status check_loss(const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                              const hada_tensor *dx, hada_error *err)
{
    if ((int)desc->loss < HADA_LOSS_MSE || desc->loss > HADA_LOSS_SSIM)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "there is no loss %d", (int)desc->loss);
    const int alone = desc->loss == HADA_LOSS_TV || desc->loss == HADA_LOSS_TV_SQUARED;
    if (alone != !target)
        return hada_fail(err, HADA_ERROR_ARGUMENT, alone ? "total variation has no target" : "the loss needs a target");
    HADA_TRY(hada_layer_check("loss", x, target ? target : x, 1, err));
    if (dx)
        HADA_TRY(hada_layer_check("gradient of the loss", x, dx, 1, err));
    return HADA_OK;
}

/* Value by value: mean of squares, of absolute values, of logits' entropies. */
static hada_status by_value(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x,
                            const hada_tensor *target, const hada_tensor *dx, int accumulate,
                            const hada_layer_grid *grid, cl_mem scratch, hada_error *err)
{
    const hada_tensor *to = dx ? dx : x; /* not written where there is no gradient */
    const hada_loss_term term = {.loss = (int)desc->loss,
                                 .has_gradient = dx != NULL,
                                 .accumulate = accumulate,
                                 .scale = (cl_float)(desc->weight / values_of(x))};
    return hada_launch_net_loss_values(slot, HADA_PROGRAM_OF_LAYER(NET_LOSS, slot, x->block), &grid->range, err,
                                       .x = x->mem, .target = target->mem, .dx = to->mem, .sums = scratch,
                                       .at_x = hada_layout_of(x), .at_target = hada_layout_of(target),
                                       .at_dx = hada_layout_of(to), .span = grid->span, .term = term);
}

static hada_status variation(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *dx,
                             int accumulate, const hada_layer_grid *grid, cl_mem scratch, hada_error *err)
{
    const hada_tensor *to = dx ? dx : x;
    const hada_loss_term term = {.loss = (int)desc->loss,
                                 .has_gradient = dx != NULL,
                                 .accumulate = accumulate,
                                 .scale = desc->weight / (cl_float)x->images};
    return hada_launch_net_loss_variation(slot, HADA_PROGRAM_OF_LAYER(NET_LOSS, slot, x->block), &grid->range, err,
                                          .x = x->mem, .dx = to->mem, .sums = scratch, .at_x = hada_layout_of(x),
                                          .at_dx = hada_layout_of(to), .span = grid->span, .term = term);
}

hada_status hada_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x, const hada_tensor *target,
                          hada_floats value, const hada_tensor *dx, int accumulate, cl_mem scratch, hada_error *err)
{
    HADA_TRY(check_loss(desc, x, target, dx, err));
    if (desc->loss == HADA_LOSS_SSIM)
        return ssim_run(slot, desc, x, target, value, dx, accumulate, scratch, err);
    const hada_layer_grid grid = hada_layer_sum_grid_of(slot, x);
    double count = values_of(x);
    if (target) {
        HADA_TRY(by_value(slot, desc, x, target, dx, accumulate, &grid, scratch, err));
    } else {
        HADA_TRY(variation(slot, desc, x, dx, accumulate, &grid, scratch, err));
        count = x->images;
    }
    return hada_sum_floats(slot, scratch, 0, hada_layer_grid_sums(&grid), (float)(desc->weight / count), 0.0f, value,
                           err);
}
