/* Structural similarity as a loss: 1 - its mean. Works on planar copies of the images: few channels stand in a block,
 * so that vectors along the rows do less. */
#include "net/ssim_loss.h"

#include "launch/net_ssim.h"
#include "net/layer_launch.h"

enum { ROW_ITEMS = 32 }; /* work-items that share a row on GPUs */

/* Constants of the formula, Wang et al. 2004. */
#define K1 0.01
#define K2 0.03

/* Places in the scratch: planar x and target, five local means (later three gradients), three derivatives, sums. */
typedef struct places {
    int planes, out_rows;
    hada_ssim_layout at;
} places;

static places places_of(const hada_tensor *x)
{
    const int pitch = (int)hada_round_up((size_t)x->cols, 8) + 16; /* windows of the last vector reach further */
    places p = {.planes = x->images * x->channels,
                .out_rows = x->rows - HADA_SSIM_SIZE + 1,
                .at = {.rows = x->rows, .cols = x->cols, .pitch = pitch}};
    const size_t rows = (size_t)p.planes * (size_t)p.out_rows;
    p.at.target = (size_t)p.planes * (size_t)x->rows * (size_t)pitch;
    p.at.means = 2 * p.at.target;
    p.at.slopes = p.at.means + rows * 5 * (size_t)pitch;
    p.at.sums = p.at.slopes + rows * 3 * (size_t)(pitch + 2 * HADA_SSIM_MARGIN);
    return p;
}

static int large_enough(const hada_tensor *x)
{
    return x->rows >= HADA_SSIM_SIZE && x->cols >= HADA_SSIM_SIZE;
}

size_t hada_ssim_loss_scratch(const hada_tensor *x)
{
    if (!large_enough(x))
        return sizeof(float); /* the run will say why not */
    const places p = places_of(x);
    const size_t items = (size_t)p.planes * (size_t)p.out_rows * ROW_ITEMS;
    return ((size_t)p.at.sums + items + hada_sum_scratch(items)) * sizeof(float);
}

static size_t row_items(const hada_slot *slot)
{
    return slot->context->shape == HADA_SHAPE_GROUPS ? ROW_ITEMS : 1;
}

static hada_range rows_range(const hada_slot *slot, int rows, int planes)
{
    return hada_range_groups(1, row_items(slot), (size_t)rows, (size_t)planes);
}

static hada_status planar(hada_slot *slot, const hada_tensor *x, const places *p, size_t offset, cl_mem scratch,
                          hada_error *err)
{
    const size_t plane = (size_t)p->at.rows * (size_t)p->at.pitch;
    const hada_planar to = {scratch, offset, plane * (size_t)x->channels, plane, (size_t)p->at.pitch};
    return hada_tensor_store(slot, x, &to, err);
}

/* The sums of S per work-item, and the derivatives. */
static hada_status compare(hada_slot *slot, const hada_loss_desc *desc, const places *p, cl_mem scratch,
                           hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_range range = rows_range(slot, p->out_rows, p->planes);
    HADA_TRY(
        hada_launch_net_ssim_down(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &range, err, .scratch = scratch, .at = p->at));
    HADA_TRY(hada_launch_net_ssim_along(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &range, err, .scratch = scratch,
                                        .at = p->at, .c1 = (cl_float)(K1 * desc->peak * K1 * desc->peak),
                                        .c2 = (cl_float)(K2 * desc->peak * K2 * desc->peak)));
done:
    return status;
}

static hada_status gradient(hada_slot *slot, const places *p, float factor, const hada_tensor *dx, int accumulate,
                            cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    const hada_tensor_layout at_dx = hada_layout_of(dx);
    const hada_range along = rows_range(slot, p->out_rows, p->planes);
    const hada_range down = rows_range(slot, p->at.rows, dx->images * at_dx.blocks);
    HADA_TRY(hada_launch_net_ssim_back_along(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &along, err, .scratch = scratch,
                                             .at = p->at));
    HADA_TRY(hada_launch_net_ssim_back_down(slot, HADA_PROGRAM_NET_SSIM_DEFAULT, &down, err, .scratch = scratch,
                                            .at = p->at, .dx = dx->mem, .at_dx = at_dx, .block = dx->block,
                                            .scale = factor, .accumulate = accumulate));
done:
    return status;
}

hada_status hada_ssim_loss_run(hada_slot *slot, const hada_loss_desc *desc, const hada_tensor *x,
                               const hada_tensor *target, hada_floats value, const hada_tensor *dx, int accumulate,
                               cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    if (!large_enough(x))
        return hada_fail(err, HADA_ERROR_SIZE, "structural similarity needs images of at least 11 x 11, not %d x %d",
                         x->rows, x->cols);
    if (!(desc->peak > 0.0f))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a peak of %g is not possible; it must be above 0", desc->peak);
    const places p = places_of(x);
    const size_t windows = (size_t)p.planes * (size_t)p.out_rows * (size_t)(p.at.cols - HADA_SSIM_SIZE + 1);
    const size_t sums = (size_t)p.planes * (size_t)p.out_rows * row_items(slot);
    const float factor = (float)(-(double)desc->weight / (double)windows);
    HADA_TRY(planar(slot, x, &p, p.at.x, scratch, err));
    HADA_TRY(planar(slot, target, &p, p.at.target, scratch, err));
    HADA_TRY(compare(slot, desc, &p, scratch, err));
    HADA_TRY(hada_sum_floats(slot, scratch, (size_t)p.at.sums, sums, factor, desc->weight, value, err));
    if (dx)
        HADA_TRY(gradient(slot, &p, factor, dx, accumulate, scratch, err));
done:
    return status;
}
