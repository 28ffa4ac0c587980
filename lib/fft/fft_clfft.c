/* The clFFT back end. clFFT 2.12.2 needs rules (docs/explanation/speed-and-accuracy.md): one lock round everything but
 * transforms, a plan for each slot, temporary buffers, strides, distances and scales of our own, a C numeric locale
 * while it writes kernel text (thread-local, so that the process keeps its own), and a check of every plan, since
 * baking reports success for kernels that do not compile. It has no pruning, bands or products: kernels/fft_plain.cl
 * does these around it. */
#include <locale.h>
#include <pthread.h>

#include "fft/fft_internal.h" /* says which OpenCL version, before clFFT does */
#include "launch/fft_plain.h"
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

/* What calls return where the text that clFFT writes does not compile. */
static int is_of_compiling(clfftStatus code)
{
    return code == CLFFT_BUILD_PROGRAM_FAILURE || code == CLFFT_INVALID_PROGRAM ||
           code == CLFFT_INVALID_PROGRAM_EXECUTABLE || code == CLFFT_INVALID_KERNEL_NAME;
}

static hada_status fail(hada_error *err, clfftStatus code, const char *call)
{
    if (is_of_compiling(code))
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "what clFFT writes for this transform does not compile here (%s, %d): take it out of the tuning "
            "file",
            call, (int)code);
    if (code > -1000 && code < 0)
        return hada_fail_cl(err, code, call);
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s refuses this transform (%d): take it out of the tuning file",
                     call, (int)code);
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

/* Called by make_plan_locked(). */
static hada_status make_plan(clfft_state *state, const hada_slot *slot, const hada_fft_desc *desc, size_t *temporary,
                             hada_error *err)
{
    const size_t lengths[2] = {(size_t)desc->cols, (size_t)desc->rows};
    clfftStatus code = CLFFT_SUCCESS;
    if (!users) {
        /* what clfftInitSetupData() does: in C that is an inline function which no object defines, and compilers that
         * inline nothing leave it to the linker */
        const clfftSetupData setup = {
            .major = clfftVersionMajor, .minor = clfftVersionMinor, .patch = clfftVersionPatch};
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

/* The same under the lock and in the C numeric locale, in which clFFT writes its kernels. */
static hada_status make_plan_locked(clfft_state *state, const hada_slot *slot, const hada_fft_desc *desc,
                                    size_t *temporary, hada_error *err)
{
    locale_t numeric = newlocale(LC_NUMERIC_MASK, "C", (locale_t)0);
    if (!numeric)
        return hada_fail(err, HADA_ERROR_MEMORY, "the C locale cannot be had: free some memory");
    pthread_mutex_lock(&lock);
    const locale_t before = uselocale(numeric);
    const hada_status status = make_plan(state, slot, desc, temporary, err);
    uselocale(before);
    pthread_mutex_unlock(&lock);
    freelocale(numeric);
    return status;
}

/* clFFT says how much temporary memory it takes only once it has its plan, so its buffers are never shared. For a dry
 * run it is taken to be that of the spectra: it was never more. */
static hada_status clfft_create(hada_fft *plan, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    hada_context *context = plan->slot->context;
    size_t temporary = 0;
    if (context->quirks.avoid_clfft)
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "clFFT is not used on %s (see 'hadalens devices'): take it out of the tuning file",
                         context->info.name);
    if (!hada_program_can_compile(context))
        return hada_fail(
            err, HADA_ERROR_UNSUPPORTED,
            "clFFT compiles its kernels at run time, which %s does not allow: take it out of the tuning file",
            context->info.has_compiler ? "a folder of offline binaries" : context->info.name);
    if (!hada_clfft_takes(desc->rows) || !hada_clfft_takes(desc->cols))
        return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                         "clFFT takes lengths with prime factors up to 13, not %d x %d: take it out of the tuning file "
                         "or pad to %d x %d",
                         desc->rows, desc->cols, hada_fft_good_size(desc->rows), hada_fft_good_size(desc->cols));
    const size_t half = half_count(desc) * (size_t)desc->batch * 2 * sizeof(float);
    HADA_TRY(hada_allocated(plan->state = hada_alloc(1, sizeof(clfft_state), "a transform's plan", err)));
    clfft_state *state = plan->state;
    if (context->dry)
        temporary = half;
    else
        HADA_TRY(make_plan_locked(state, plan->slot, desc, &temporary, err));
    HADA_TRY(hada_buffer_create(&state->grid, context, grid_count(desc) * (size_t)desc->batch * sizeof(float),
                                "a transform's scratch", err));
    HADA_TRY(hada_buffer_create(&state->half, context, half, "a transform's scratch", err));
    if (temporary)
        HADA_TRY(hada_buffer_create(&state->temporary, context, temporary, "a transform's scratch", err));
    return HADA_OK;
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
    HADA_DESTROY_BUFFERS(&state->grid, &state->half, &state->temporary);
    free(state);
    plan->state = NULL;
}

/* One block: row-major. */
static int clfft_block(int cols)
{
    return cols / 2 + 1;
}

static hada_status transform(hada_fft *plan, clfftDirection direction, hada_buffer *in, hada_buffer *out,
                             hada_error *err)
{
    const clfft_state *state = plan->state;
    const double points = (double)grid_count(&plan->desc), images = plan->desc.batch;
    cl_event begin;
    HADA_TRY(hada_slot_span_begin(plan->slot, &begin, err));
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

static hada_range elements(size_t count)
{
    return hada_range_of(count, GROUP_SIZE, 1, 1);
}

static hada_status clfft_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                                 size_t spectrum_offset, hada_error *err)
{
    clfft_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const hada_fft_real images = hada_fft_real_of(desc, real_offset, 1, batch);
    const size_t count = grid_count(desc) * (size_t)batch;
    const hada_range range = elements(count);
    hada_slot_cost(plan->slot, 4.0 * batch * (1.0 * images.rows * images.cols + (double)grid_count(desc)), 0);
    HADA_TRY(hada_launch_fft_plain_pad(plan->slot, HADA_PROGRAM_FFT_PLAIN_DEFAULT, &range, err, .in = real,
                                       .real = images, .out = state->grid.mem, .rows = desc->rows, .cols = desc->cols,
                                       .count = count));
    HADA_TRY(transform(plan, CLFFT_FORWARD, &state->grid, &state->half, err));
    return hada_buffer_copy(plan->slot, state->half.mem, 0, spectrum, spectrum_offset * 8,
                            half_count(desc) * (size_t)batch * 8, err);
}

static hada_status clfft_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                                 size_t real_offset, const hada_fft_filter *use, hada_error *err)
{
    clfft_state *state = plan->state;
    const hada_fft_desc *desc = &plan->desc;
    const size_t half = half_count(desc) * (size_t)batch;
    const hada_fft_band band = {desc->rows, desc->cols, use->band_rows, use->band_cols};
    const hada_fft_real images = hada_fft_real_of(desc, real_offset, use->stride, batch);
    const size_t pixels = (size_t)images.rows * (size_t)images.cols * (size_t)batch;
    const hada_range halves = elements(half), rectangles = elements(pixels);
    const double filtered = use->product == HADA_FFT_PLAIN ? 0 : use->half ? 4 : 8;
    hada_slot_cost(plan->slot, 8.0 * (double)half_count(desc) * use->spectrum_count + (8.0 + filtered) * (double)half,
                   filtered > 0 ? 6.0 * (double)half : 0);
    HADA_TRY(hada_launch_fft_plain_product(
        plan->slot, hada_find_fft_plain(.fft_product = (int)use->product, .fft_half = use->half), &halves, err,
        .in = spectrum, .in_offset = spectrum_offset, .in_count = use->spectrum_count, .filter = use->filter,
        .filter_offset = (size_t)use->filter_first * half_count(desc), .filter_step = use->stride,
        .out = state->half.mem, .band = band, .count = half));
    HADA_TRY(transform(plan, CLFFT_BACKWARD, &state->half, &state->grid, err));
    hada_slot_cost(plan->slot, 8.0 * (double)pixels, 0);
    return hada_launch_fft_plain_crop(plan->slot, HADA_PROGRAM_FFT_PLAIN_DEFAULT, &rectangles, err,
                                      .in = state->grid.mem, .rows = desc->rows, .cols = desc->cols, .out = real,
                                      .real = images, .count = pixels);
}

const hada_fft_engine hada_fft_clfft_engine = {
    clfft_create, clfft_destroy, clfft_forward, clfft_inverse, clfft_block,
};
