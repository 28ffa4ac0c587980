/* The clFFT back end. clFFT 2.12.2 needs rules (docs/fft.md): one lock round everything but transforms, a plan for
 * each slot, temporary buffers, strides, distances and scales of our own, a C numeric locale while it writes kernel
 * text (thread-local, so that the process keeps its own), and a check of every plan, since baking reports success for
 * kernels that do not compile. It has no pruning, bands or products: kernels/fft_plain.cl does these around it. */
#include <locale.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>

#include "core/alloc.h"
#include "fft/fft_internal.h" /* says which OpenCL version, before clFFT does */
#include "runtime/kernel.h"
#include "runtime/program.h"

#include <clFFT.h>

#define GROUP_SIZE 64

typedef struct clfft_state {
    int set_up; /* holds a reference of the library */
    int planned;
    clfftPlanHandle handle;
    hada_buffer grid, half, temporary; /* real images, half spectra, clFFT's own */
} clfft_state;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static int users; /* plans alive; guarded by the lock */

static hada_status fail(hada_error *err, clfftStatus code, const char *call)
{
    if (code > -1000 && code < 0)
        return hada_fail_cl(err, code, call);
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s refuses this transform (%d): leave the choice to the table", call,
                     (int)code);
}

int hada_clfft_takes(int n)
{
    static const int primes[] = {2, 3, 5, 7, 11, 13};
    for (int i = 0; i < 6; i++)
        while (n > 1 && n % primes[i] == 0)
            n /= primes[i];
    return n == 1;
}

static size_t half_count(const hada_fft_desc *desc)
{
    return (size_t)desc->rows * (size_t)(desc->cols / 2 + 1);
}

static size_t grid_count(const hada_fft_desc *desc)
{
    return (size_t)desc->rows * (size_t)desc->cols;
}

/* Called under the lock. */
static clfftStatus describe(clfft_state *state, const hada_slot *slot, const hada_fft_desc *desc)
{
    const int forward = desc->direction == HADA_FFT_FORWARD;
    const clfftPlanHandle plan = state->handle;
    size_t real_strides[2] = {1, (size_t)desc->cols}, half_strides[2] = {1, (size_t)desc->cols / 2 + 1};
    cl_command_queue queue = slot->queue;
    clfftStatus code = clfftSetPlanPrecision(plan, CLFFT_SINGLE);
    if (!code)
        code = clfftSetLayout(plan, forward ? CLFFT_REAL : CLFFT_HERMITIAN_INTERLEAVED,
                              forward ? CLFFT_HERMITIAN_INTERLEAVED : CLFFT_REAL);
    if (!code)
        code = clfftSetResultLocation(plan, CLFFT_OUTOFPLACE);
    if (!code)
        code = clfftSetPlanBatchSize(plan, (size_t)desc->batch);
    if (!code)
        code = clfftSetPlanInStride(plan, CLFFT_2D, forward ? real_strides : half_strides);
    if (!code)
        code = clfftSetPlanOutStride(plan, CLFFT_2D, forward ? half_strides : real_strides);
    if (!code)
        code = forward ? clfftSetPlanDistance(plan, grid_count(desc), half_count(desc))
                       : clfftSetPlanDistance(plan, half_count(desc), grid_count(desc));
    if (!code)
        code = clfftSetPlanScale(plan, CLFFT_FORWARD, 1.0f);
    if (!code)
        code = clfftSetPlanScale(plan, CLFFT_BACKWARD, (cl_float)(1.0 / (double)grid_count(desc)));
    if (!code)
        code = clfftBakePlan(plan, 1, &queue, NULL, NULL);
    return code;
}

/* Called under the lock, in the C numeric locale. */
static hada_status make_plan(clfft_state *state, const hada_slot *slot, const hada_fft_desc *desc, size_t *temporary,
                             hada_error *err)
{
    const size_t lengths[2] = {(size_t)desc->cols, (size_t)desc->rows};
    clfftStatus code = CLFFT_SUCCESS;
    if (!users) {
        clfftSetupData setup;
        code = clfftInitSetupData(&setup);
        if (!code)
            code = clfftSetup(&setup);
        if (code)
            return fail(err, code, "clfftSetup");
    }
    users++;
    state->set_up = 1;
    code = clfftCreateDefaultPlan(&state->handle, slot->context->cl, CLFFT_2D, lengths);
    if (code)
        return fail(err, code, "clfftCreateDefaultPlan");
    state->planned = 1;
    code = describe(state, slot, desc);
    if (!code)
        code = clfftGetTmpBufSize(state->handle, temporary);
    return code ? fail(err, code, "clfftBakePlan") : HADA_OK;
}

static hada_status clfft_create(hada_fft *plan, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    hada_context *context = plan->slot->context;
    size_t temporary = 0;
    if (context->quirks.avoid_clfft)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "clFFT is not used on %s (see 'hadalens devices'): leave the choice to the table",
                         context->info.name);
    if (!hada_program_can_compile(context))
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "clFFT compiles its kernels at run time, which %s does not allow: leave the choice to the table",
            context->info.has_compiler ? "a folder of offline binaries" : context->info.name);
    if (!hada_clfft_takes(desc->rows) || !hada_clfft_takes(desc->cols))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "clFFT takes lengths with prime factors up to 13, not %d x %d: leave the choice to the table "
                         "or pad to %d x %d",
                         desc->rows, desc->cols, hada_fft_good_size(desc->rows), hada_fft_good_size(desc->cols));
    hada_status status = hada_alloc(&plan->state, 1, sizeof(clfft_state), "a transform's plan", err);
    if (status)
        return status;
    clfft_state *state = plan->state;
    locale_t numeric = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (!numeric)
        return hada_fail(err, HADA_ERROR_MEMORY, "the C locale cannot be had: free some memory");
    pthread_mutex_lock(&lock);
    const locale_t before = uselocale(numeric);
    status = make_plan(state, plan->slot, desc, &temporary, err);
    uselocale(before);
    pthread_mutex_unlock(&lock);
    freelocale(numeric);
    if (!status)
        status = hada_buffer_create(&state->grid, context, grid_count(desc) * (size_t)desc->batch * sizeof(float),
                                    "a transform's scratch", err);
    if (!status)
        status = hada_buffer_create(&state->half, context, half_count(desc) * (size_t)desc->batch * 2 * sizeof(float),
                                    "a transform's scratch", err);
    if (!status && temporary)
        status = hada_buffer_create(&state->temporary, context, temporary, "a transform's scratch", err);
    return status;
}

static void clfft_destroy(hada_fft *plan)
{
    clfft_state *state = plan->state;
    if (!state)
        return;
    hada_slot_finish(plan->slot, NULL);
    pthread_mutex_lock(&lock);
    if (state->planned)
        clfftDestroyPlan(&state->handle);
    if (state->set_up && --users == 0)
        clfftTeardown();
    pthread_mutex_unlock(&lock);
    hada_buffer_destroy(&state->grid);
    hada_buffer_destroy(&state->half);
    hada_buffer_destroy(&state->temporary);
    free(state);
    plan->state = NULL;
}

/* clFFT's own temporary memory is known only after baking; it was never more than the spectra. */
static size_t clfft_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    (void)context;
    return (grid_count(desc) + 4 * half_count(desc)) * (size_t)desc->batch * sizeof(float);
}

/* One block: row-major. */
static int clfft_block(const hada_context *context, int rows, int cols)
{
    (void)context;
    (void)rows;
    return cols / 2 + 1;
}

static hada_status launch(hada_fft *plan, const char *kernel_name, const char *options, cl_ulong count, hada_arg *args,
                          size_t arg_count, hada_error *err)
{
    const size_t local = GROUP_SIZE, global = (count + GROUP_SIZE - 1) / GROUP_SIZE * GROUP_SIZE;
    cl_kernel kernel;
    hada_status status = hada_slot_kernel(plan->slot, "fft_plain", kernel_name, options, &kernel, err);
    return status ? status
                  : hada_slot_launch(plan->slot, kernel, kernel_name, 1, &global, &local, args, arg_count, err);
}

static hada_status transform(hada_fft *plan, clfftDirection direction, hada_buffer *in, hada_buffer *out,
                             hada_error *err)
{
    const clfft_state *state = plan->state;
    const double points = (double)grid_count(&plan->desc), images = plan->desc.batch;
    cl_event begin;
    hada_status status = hada_slot_span_begin(plan->slot, &begin, err);
    if (status)
        return status;
    clfftStatus code = clfftEnqueueTransform(state->handle, direction, 1, &plan->slot->queue, 0, NULL, NULL, &in->mem,
                                             &out->mem, state->temporary.mem);
    if (code && begin)
        clReleaseEvent(begin);
    if (code)
        return fail(err, code, "clfftEnqueueTransform");
    hada_slot_cost(plan->slot, images * (4.0 * points + 8.0 * (double)half_count(&plan->desc)),
                   images * 2.5 * points * log2(points));
    return hada_slot_span_end(plan->slot, "clfft", begin, err);
}

static hada_status clfft_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                                 size_t spectrum_offset, hada_error *err)
{
    clfft_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const cl_ulong in_offset = real_offset, in_distance = desc->real_distance, in_pitch = desc->real_pitch,
                   count = grid_count(desc) * (size_t)batch;
    const cl_int row0 = desc->row0, col0 = desc->col0, rows_in = desc->real_rows, cols_in = desc->real_cols,
                 rows = desc->rows, cols = desc->cols;
    hada_arg args[] = {HADA_ARG(real),     HADA_ARG(in_offset), HADA_ARG(in_distance),
                       HADA_ARG(in_pitch), HADA_ARG(row0),      HADA_ARG(col0),
                       HADA_ARG(rows_in),  HADA_ARG(cols_in),   HADA_ARG(state->grid.mem),
                       HADA_ARG(rows),     HADA_ARG(cols),      HADA_ARG(count)};
    hada_slot_cost(plan->slot, 4.0 * batch * (1.0 * rows_in * cols_in + (double)grid_count(desc)), 0);
    hada_status status = launch(plan, "fft_plain_pad", "", count, args, HADA_COUNT(args), err);
    if (!status)
        status = transform(plan, CLFFT_FORWARD, &state->grid, &state->half, err);
    if (status)
        return status;
    cl_int code = clEnqueueCopyBuffer(plan->slot->queue, state->half.mem, spectrum, 0, spectrum_offset * 8,
                                      half_count(desc) * (size_t)batch * 8, 0, NULL, hada_slot_event(plan->slot));
    if (code != CL_SUCCESS)
        return hada_fail_cl(err, code, "clEnqueueCopyBuffer");
    hada_slot_moved(plan->slot, "copy", 16.0 * (double)half_count(desc) * batch);
    return HADA_OK;
}

static hada_status clfft_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                                 size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    clfft_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const cl_ulong in_offset = spectrum_offset, half = half_count(desc) * (size_t)batch,
                   filter_offset = filter ? (size_t)filter->filter_first * half_count(desc) : 0;
    const hada_fft_filter use = hada_fft_resolve(plan, filter);
    const cl_int in_count = filter ? filter->spectrum_count : batch, rows = desc->rows, cols = desc->cols,
                 band_rows = use.band_rows, band_cols = use.band_cols, filter_step = use.stride;
    const cl_mem filters = filter ? filter->filter : NULL;
    const char *options = "";
    if (filter && filter->product == HADA_FFT_COMPLEX)
        options = filter->half ? "-DFFT_PRODUCT=1 -DFFT_HALF=1" : "-DFFT_PRODUCT=1";
    else if (filter)
        options = filter->half ? "-DFFT_PRODUCT=2 -DFFT_HALF=1" : "-DFFT_PRODUCT=2";
    hada_arg product[] = {HADA_ARG(spectrum),
                          HADA_ARG(in_offset),
                          HADA_ARG(in_count),
                          HADA_ARG(filters),
                          HADA_ARG(filter_offset),
                          HADA_ARG(filter_step),
                          HADA_ARG(rows),
                          HADA_ARG(cols),
                          HADA_ARG(band_rows),
                          HADA_ARG(band_cols),
                          HADA_ARG(state->half.mem),
                          HADA_ARG(half)};
    const double filtered = !filter ? 0 : filter->half ? 4 : 8;
    hada_slot_cost(plan->slot, 8.0 * (double)half_count(desc) * in_count + (8.0 + filtered) * (double)half,
                   filter ? 6.0 * (double)half : 0);
    hada_status status = launch(plan, "fft_plain_product", options, half, product, HADA_COUNT(product), err);
    if (!status)
        status = transform(plan, CLFFT_BACKWARD, &state->half, &state->grid, err);
    if (status)
        return status;
    const cl_ulong out_offset = real_offset, out_distance = desc->real_distance * (size_t)use.stride,
                   out_pitch = desc->real_pitch,
                   count = (cl_ulong)desc->real_rows * (cl_ulong)desc->real_cols * (cl_ulong)batch;
    const cl_int row0 = desc->row0, col0 = desc->col0, rows_out = desc->real_rows, cols_out = desc->real_cols;
    hada_arg crop[] = {
        HADA_ARG(state->grid.mem), HADA_ARG(rows),      HADA_ARG(cols), HADA_ARG(real), HADA_ARG(out_offset),
        HADA_ARG(out_distance),    HADA_ARG(out_pitch), HADA_ARG(row0), HADA_ARG(col0), HADA_ARG(rows_out),
        HADA_ARG(cols_out),        HADA_ARG(count)};
    hada_slot_cost(plan->slot, 8.0 * (double)count, 0);
    return launch(plan, "fft_plain_crop", "", count, crop, HADA_COUNT(crop), err);
}

/* Its buffers are few and its own: nothing is shared. */
static size_t clfft_scratch(const hada_context *context, const hada_fft_desc *desc)
{
    (void)context;
    (void)desc;
    return 0;
}

const hada_fft_engine hada_fft_clfft_engine = {
    clfft_create, clfft_destroy, clfft_forward, clfft_inverse, clfft_bytes, clfft_block, clfft_scratch,
};
