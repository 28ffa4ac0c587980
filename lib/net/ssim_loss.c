/* Structural similarity as a loss: 1 - its mean. Works on planar copies of the images: few channels stand in a block,
 * so that vectors along the rows do less. */
#include "net/ssim_loss.h"

#include "net/layer_launch.h"
#include "runtime/kernel.h"

/* As in net_ssim.cl; ROW_ITEMS work-items share a row on GPUs. */
enum { SIZE = 11, MARGIN = 16, ROW_ITEMS = 32 };

/* Places in the scratch, in floats: planar x and target, five local means (later three gradients), three slopes, sums.
 */
typedef struct places {
    int planes, rows, cols, pitch, out_rows;
    size_t x, target, means, slopes, sums;
} places;

static places places_of(const hada_tensor *x)
{
    places p = {.planes = x->images * x->channels, .rows = x->rows, .cols = x->cols};
    p.pitch = (x->cols + 7) / 8 * 8 + 16; /* windows of a vector of columns reach behind the last one */
    p.out_rows = x->rows - SIZE + 1;
    const size_t plane = (size_t)x->rows * (size_t)p.pitch, planes = (size_t)p.planes;
    p.target = planes * plane;
    p.means = 2 * p.target;
    p.slopes = p.means + planes * 5 * (size_t)p.out_rows * (size_t)p.pitch;
    p.sums = p.slopes + planes * 3 * (size_t)p.out_rows * (size_t)(p.pitch + 2 * MARGIN);
    return p;
}

static int large_enough(const hada_tensor *x)
{
    return x->rows >= SIZE && x->cols >= SIZE;
}

size_t hada_ssim_loss_scratch(const hada_tensor *x)
{
    if (!large_enough(x))
        return sizeof(float); /* the run will say why not */
    const places p = places_of(x);
    const size_t items = (size_t)p.planes * (size_t)p.out_rows * ROW_ITEMS;
    return (p.sums + items + hada_sum_scratch(items)) * sizeof(float);
}

static hada_status launch(hada_slot *slot, const char *name, int rows, int planes, const hada_arg *args, size_t count,
                          hada_error *err)
{
    hada_status status = HADA_OK;
    const size_t items = slot->context->shape == HADA_SHAPE_GROUPS ? ROW_ITEMS : 1;
    const size_t local[3] = {items, 1, 1}, global[3] = {items, (size_t)rows, (size_t)planes};
    cl_kernel kernel;
    HADA_TRY(hada_slot_kernel(slot, "net_ssim", name, "", &kernel, err));
    HADA_TRY(hada_slot_launch(slot, kernel, name, 3, global, local, args, count, err));
done:
    return status;
}

static hada_status planar(hada_slot *slot, const hada_tensor *x, const places *p, size_t offset, cl_mem scratch,
                          hada_error *err)
{
    const size_t plane = (size_t)p->rows * (size_t)p->pitch;
    const hada_planar to = {scratch, offset, plane * (size_t)x->channels, plane, (size_t)p->pitch};
    return hada_tensor_store(slot, x, &to, err);
}

/* The sums of S per work-item, and the slopes. */
static hada_status compare(hada_slot *slot, const hada_loss_desc *desc, const places *p, cl_mem scratch,
                           hada_error *err)
{
    hada_status status = HADA_OK;
    const cl_ulong x = p->x, target = p->target, means = p->means, slopes = p->slopes, sums = p->sums;
    const cl_float c1 = (cl_float)(0.01 * desc->peak * 0.01 * desc->peak);
    const cl_float c2 = (cl_float)(0.03 * desc->peak * 0.03 * desc->peak);
    const hada_arg down[] = {HADA_ARG(scratch), HADA_ARG(x),       HADA_ARG(target),
                             HADA_ARG(means),   HADA_ARG(p->rows), HADA_ARG(p->pitch)};
    const hada_arg along[] = {HADA_ARG(scratch), HADA_ARG(means),    HADA_ARG(slopes), HADA_ARG(sums),
                              HADA_ARG(p->cols), HADA_ARG(p->pitch), HADA_ARG(c1),     HADA_ARG(c2)};
    HADA_TRY(launch(slot, "net_ssim_down", p->out_rows, p->planes, down, HADA_COUNT(down), err));
    HADA_TRY(launch(slot, "net_ssim_along", p->out_rows, p->planes, along, HADA_COUNT(along), err));
done:
    return status;
}

static hada_status gradient(hada_slot *slot, const places *p, float factor, const hada_tensor *dx, int accumulate,
                            cl_mem scratch, hada_error *err)
{
    hada_status status = HADA_OK;
    const cl_ulong x = p->x, target = p->target, means = p->means, slopes = p->slopes;
    const hada_tensor_place at_dx = hada_tensor_place_of(dx);
    const cl_float scale = factor;
    const cl_int add = accumulate;
    const hada_arg along[] = {HADA_ARG(scratch), HADA_ARG(slopes), HADA_ARG(means), HADA_ARG(p->pitch)};
    const hada_arg down[] = {
        HADA_ARG(scratch),      HADA_ARG(x),         HADA_ARG(target),   HADA_ARG(means),
        HADA_ARG(p->rows),      HADA_ARG(p->cols),   HADA_ARG(p->pitch), HADA_ARG_TENSOR(dx, at_dx),
        HADA_ARG(dx->channels), HADA_ARG(dx->block), HADA_ARG(scale),    HADA_ARG(add)};
    HADA_TRY(launch(slot, "net_ssim_back_along", p->out_rows, p->planes, along, HADA_COUNT(along), err));
    HADA_TRY(
        launch(slot, "net_ssim_back_down", p->rows, dx->images * hada_tensor_blocks(dx), down, HADA_COUNT(down), err));
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
    const size_t windows = (size_t)p.planes * (size_t)p.out_rows * (size_t)(p.cols - SIZE + 1);
    const size_t share = slot->context->shape == HADA_SHAPE_GROUPS ? ROW_ITEMS : 1;
    const float factor = (float)(-(double)desc->weight / (double)windows);
    HADA_TRY(planar(slot, x, &p, p.x, scratch, err));
    HADA_TRY(planar(slot, target, &p, p.target, scratch, err));
    HADA_TRY(compare(slot, desc, &p, scratch, err));
    HADA_TRY(hada_sum_floats(slot, scratch, p.sums, (size_t)p.planes * (size_t)p.out_rows * share, factor, desc->weight,
                             value, err));
    if (dx)
        HADA_TRY(gradient(slot, &p, factor, dx, accumulate, scratch, err));
done:
    return status;
}
