/* Plans: the checks that all back ends share, and the way to the one that serves. */
#include "fft/fft.h"
#include "fft/fft_internal.h"
#include "runtime/program.h"
#include "runtime/tuning.h"

/* A new plan is run once on a few points whose transform is evaluated directly in double precision. The points reach
 * every output, so that a wrong lane, block or twiddle factor anywhere on their way shows. */

#define POINTS    24
#define TOLERANCE 1e-5 /* of the root of the sum of squares */
#define TWO_PI    6.283185307179586476925286766559

typedef struct point {
    int y, x;
    double re, im;
} point;

static unsigned next_random(unsigned *state)
{
    *state = *state * 1664525u + 1013904223u;
    return *state >> 8;
}

/* Points of a grid: its corners and middle first, then pseudo-random ones; none twice. Returns how many. */
static int choose(point *points, int rows, int cols, int y0, int x0, unsigned seed)
{
    const int corners[5][2] = {{0, 0}, {0, cols - 1}, {rows - 1, 0}, {rows - 1, cols - 1}, {rows / 2, cols / 2}};
    int count = 0;
    for (int i = 0; i < 4 * POINTS && count < POINTS; i++) {
        unsigned a = next_random(&seed), b = next_random(&seed);
        point p = {.y = y0 + (i < 5 ? corners[i][0] : (int)(a % (unsigned)rows)),
                   .x = x0 + (i < 5 ? corners[i][1] : (int)(b % (unsigned)cols))};
        p.re = (float)next_random(&seed) / 8388608.0f - 1.0f;
        p.im = (float)next_random(&seed) / 8388608.0f - 1.0f;
        int known = 0;
        for (int k = 0; k < count; k++)
            known |= points[k].y == p.y && points[k].x == p.x;
        if (!known)
            points[count++] = p;
    }
    return count;
}

static double angle(const point *a, const point *b, int rows, int cols)
{
    return TWO_PI * ((double)((long long)a->y * b->y % rows) / rows + (double)((long long)a->x * b->x % cols) / cols);
}

static double norm(const point *points, int count)
{
    double sum = 0.0;
    for (int i = 0; i < count; i++)
        sum += points[i].re * points[i].re + points[i].im * points[i].im;
    return sqrt(sum);
}

static size_t real_index(const hada_fft_desc *desc, const point *p)
{
    return (size_t)(p->y - desc->row0) * desc->real_pitch + (size_t)(p->x - desc->col0);
}

static hada_status failed(const hada_fft *plan, double error, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_SELF_TEST,
                     "the %s transform of %d x %d gives wrong results on %s (error %.1e where %.0e is allowed): choose "
                     "another back end in the tuning file or another device",
                     plan->desc.direction == HADA_FFT_FORWARD ? "forward" : "inverse", plan->desc.rows, plan->desc.cols,
                     plan->slot->context->info.name, error, TOLERANCE);
}

static hada_status check_forward(hada_fft *plan, hada_buffer *real, hada_buffer *spectrum, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    point in[POINTS], out[POINTS];
    const int in_count = choose(in, desc->real_rows, desc->real_cols, desc->row0, desc->col0, 1u);
    const int out_count = choose(out, desc->rows, desc->band_cols + 1, 0, 0, 2u);
    HADA_TRY(hada_buffer_clear(real, plan->slot, 0, real->bytes, err));
    for (int i = 0; i < in_count; i++) {
        const float value = (float)in[i].re;
        in[i].im = 0.0;
        HADA_TRY(
            hada_buffer_write(real, plan->slot, real_index(desc, &in[i]) * sizeof value, &value, sizeof value, err));
    }
    HADA_TRY(plan->engine->forward(plan, 1, real->mem, 0, spectrum->mem, 0, err));
    const double scale = norm(in, in_count);
    for (int k = 0; k < out_count; k++) {
        float got[2];
        double re = 0.0, im = 0.0;
        HADA_TRY(hada_buffer_read(spectrum, plan->slot,
                                  hada_spectrum_index(&plan->layout, out[k].y, out[k].x) * sizeof got, got, sizeof got,
                                  err));
        for (int i = 0; i < in_count; i++) {
            const double a = angle(&in[i], &out[k], desc->rows, desc->cols);
            re += in[i].re * cos(a);
            im -= in[i].re * sin(a);
        }
        const double error = hypot(got[0] - re, got[1] - im) / scale;
        if (!(error <= TOLERANCE))
            return failed(plan, error, err);
    }
    return HADA_OK;
}

static hada_status check_inverse(hada_fft *plan, hada_buffer *real, hada_buffer *spectrum, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    point in[POINTS], out[POINTS];
    const int in_count = choose(in, desc->band_rows + 1, desc->band_cols + 1, 0, 0, 3u);
    const int out_count = choose(out, desc->real_rows, desc->real_cols, desc->row0, desc->col0, 4u);
    const double size = (double)desc->rows * desc->cols;
    const hada_fft_filter none = {.product = HADA_FFT_PLAIN,
                                  .spectrum_count = 1,
                                  .stride = 1,
                                  .band_rows = desc->band_rows,
                                  .band_cols = desc->band_cols};
    HADA_TRY(hada_buffer_clear(spectrum, plan->slot, 0, spectrum->bytes, err));
    for (int i = 0; i < in_count; i++) {
        const float value[2] = {(float)in[i].re, (float)in[i].im};
        if (in[i].y && i % 2) /* half of them at negative frequencies */
            in[i].y = desc->rows - in[i].y;
        HADA_TRY(hada_buffer_write(spectrum, plan->slot,
                                   hada_spectrum_index(&plan->layout, in[i].y, in[i].x) * sizeof value, value,
                                   sizeof value, err));
    }
    HADA_TRY(plan->engine->inverse(plan, 1, spectrum->mem, 0, real->mem, 0, &none, err));
    const double scale = norm(in, in_count);
    for (int k = 0; k < out_count; k++) {
        float got;
        double sum = 0.0;
        HADA_TRY(hada_buffer_read(real, plan->slot, real_index(desc, &out[k]) * sizeof got, &got, sizeof got, err));
        for (int i = 0; i < in_count; i++) {
            const double a = angle(&in[i], &out[k], desc->rows, desc->cols);
            const int single = in[i].x == 0 || 2 * in[i].x == desc->cols;
            sum += (single ? 1.0 : 2.0) * (in[i].re * cos(a) - in[i].im * sin(a));
        }
        const double error = fabs(got * size - sum) / scale;
        if (!(error <= TOLERANCE))
            return failed(plan, error, err);
    }
    return HADA_OK;
}

/* Runs a new plan once against known answers. */
static hada_status fft_check(hada_fft *plan, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    const size_t floats = (size_t)(desc->real_rows - 1) * desc->real_pitch + (size_t)desc->real_cols;
    hada_buffer real = {0}, spectrum = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(
        hada_buffer_create(&real, plan->slot->context, floats * sizeof(float), "a transform's check", err));
    HADA_TRY_OR_DONE(hada_buffer_create(&spectrum, plan->slot->context, plan->layout.count * 2 * sizeof(float),
                                        "a transform's check", err));
    if (!plan->slot->context->dry)
        HADA_TRY_OR_DONE(desc->direction == HADA_FFT_FORWARD ? check_forward(plan, &real, &spectrum, err)
                                                             : check_inverse(plan, &real, &spectrum, err));
done:
    hada_slot_finish(plan->slot, NULL);
    HADA_DESTROY_BUFFERS(&real, &spectrum);
    return status;
}

static const hada_fft_engine *engine_of(hada_fft_backend backend)
{
    return backend == HADA_FFT_CLFFT ? &hada_fft_clfft_engine : &hada_fft_own_engine;
}

static hada_fft_backend resolve(const hada_context *context, hada_fft_backend backend, int rows, int cols)
{
    return backend == HADA_FFT_AUTO ? hada_fft_choose(context, rows, cols) : backend;
}

hada_spectrum_layout hada_fft_layout(const hada_context *context, int rows, int cols, hada_fft_backend backend)
{
    hada_spectrum_layout layout = {.rows = rows, .cols = cols};
    layout.block = engine_of(resolve(context, backend, rows, cols))->block(cols);
    layout.blocks = (cols / 2 + 1 + layout.block - 1) / layout.block;
    layout.count = (size_t)layout.blocks * (size_t)rows * (size_t)layout.block;
    return layout;
}

static hada_status check_desc(const hada_fft_desc *desc, hada_error *err)
{
    const int largest = 1 << 24;
    if (desc->direction != HADA_FFT_FORWARD && desc->direction != HADA_FFT_INVERSE)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a transform needs a direction, forward or inverse");
    if (desc->rows < 1 || desc->cols < 1 || desc->rows > largest || desc->cols > largest)
        return hada_fail(err, HADA_ERROR_SIZE, "a transform of %d x %d is out of range: give 1 to %d rows and columns",
                         desc->rows, desc->cols, largest);
    if (desc->batch < 1)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a transform of %d images: give 1 at least", desc->batch);
    if (desc->row0 < 0 || desc->col0 < 0 || desc->real_rows < 1 || desc->real_cols < 1 ||
        desc->row0 > desc->rows - desc->real_rows || desc->col0 > desc->cols - desc->real_cols)
        return hada_fail(err, HADA_ERROR_SIZE,
                         "the rectangle of %d x %d at (%d, %d) does not lie within the transform's %d x %d",
                         desc->real_rows, desc->real_cols, desc->row0, desc->col0, desc->rows, desc->cols);
    if (desc->real_pitch < (size_t)desc->real_cols)
        return hada_fail(err, HADA_ERROR_SIZE, "a pitch of %zu floats is less than the row's %d", desc->real_pitch,
                         desc->real_cols);
    if (desc->batch > 1 &&
        desc->real_distance < (size_t)(desc->real_rows - 1) * desc->real_pitch + (size_t)desc->real_cols)
        return hada_fail(err, HADA_ERROR_SIZE, "a distance of %zu floats makes images of %d x %d overlap",
                         desc->real_distance, desc->real_rows, desc->real_cols);
    if (desc->band_rows < 0 || desc->band_cols < 0)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a band of %d x %d does not apply: bands are positive",
                         desc->band_rows, desc->band_cols);
    return HADA_OK;
}

/* 0, 0 stands for no limit. */
static void resolve_band(hada_fft_desc *desc)
{
    if (!desc->band_rows && !desc->band_cols) {
        desc->band_rows = desc->rows / 2;
        desc->band_cols = desc->cols / 2;
    }
    desc->band_rows = hada_least(desc->band_rows, desc->rows / 2);
    desc->band_cols = hada_least(desc->band_cols, desc->cols / 2);
}

hada_status hada_fft_create(hada_fft **out, hada_slot *slot, const hada_fft_desc *desc, hada_error *err)
{
    hada_fft *plan = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(check_desc(desc, err));
    HADA_TRY_OR_DONE(HADA_NEW(plan, 1, "a transform's plan", err));
    plan->slot = slot;
    plan->desc = *desc;
    plan->desc.backend = resolve(slot->context, desc->backend, desc->rows, desc->cols);
    resolve_band(&plan->desc);
    plan->layout = hada_fft_layout(slot->context, desc->rows, desc->cols, plan->desc.backend);
    plan->engine = engine_of(plan->desc.backend);
    HADA_TRY_OR_DONE(plan->engine->create(plan, err));
    HADA_TRY_OR_DONE(fft_check(plan, err));
done:
    if (status)
        hada_fft_destroy(&plan);
    *out = plan;
    return status;
}

void hada_fft_destroy(hada_fft **pointer)
{
    hada_fft *plan = hada_taken(pointer);
    if (!plan)
        return;
    plan->engine->destroy(plan);
    free(plan);
}

hada_status hada_fft_pair_create(hada_fft_pair *pair, hada_slot *slot, hada_fft_desc desc, hada_error *err)
{
    desc.direction = HADA_FFT_FORWARD;
    HADA_TRY(hada_fft_create(&pair->forward, slot, &desc, err));
    desc.direction = HADA_FFT_INVERSE;
    return hada_fft_create(&pair->inverse, slot, &desc, err);
}

void hada_fft_pair_destroy(hada_fft_pair *pair)
{
    hada_fft_destroy(&pair->forward);
    hada_fft_destroy(&pair->inverse);
}

size_t hada_fft_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    hada_dry dry;
    hada_fft *plan;
    hada_dry_begin(&dry, context);
    hada_fft_create(&plan, &dry.slot, desc, NULL);
    const uint64_t bytes = hada_context_bytes(&dry.context);
    hada_fft_destroy(&plan);
    hada_dry_end(&dry);
    return (size_t)bytes;
}

hada_fft_backend hada_fft_serving(const hada_fft *plan)
{
    return plan->desc.backend;
}

const hada_spectrum_layout *hada_fft_plan_layout(const hada_fft *plan)
{
    return &plan->layout;
}

/* The own kernels read and write spectra by two values at a time. */
static hada_status check_call(const hada_fft *plan, hada_fft_direction direction, int batch, size_t spectrum_offset,
                              hada_error *err)
{
    if (plan->desc.direction != direction)
        return hada_fail(err, HADA_ERROR_STATE, "this plan transforms in the other direction");
    if (batch < 1 || batch > plan->desc.batch)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a batch of %d: this plan takes 1 to %d images", batch,
                         plan->desc.batch);
    if (plan->desc.backend == HADA_FFT_OWN && spectrum_offset % 2)
        return hada_fail(err, HADA_ERROR_ARGUMENT, "spectra from the value %zu on: give an even offset",
                         spectrum_offset);
    return HADA_OK;
}

hada_status hada_fft_forward(hada_fft *plan, int batch, cl_mem real, size_t real_offset, cl_mem spectrum,
                             size_t spectrum_offset, hada_error *err)
{
    hada_status status = check_call(plan, HADA_FFT_FORWARD, batch, spectrum_offset, err);
    return status ? status : plan->engine->forward(plan, batch, real, real_offset, spectrum, spectrum_offset, err);
}

/* A call's filter with what its zeros stand for filled in: stride 1, the plan's band; none: as many spectra as images.
 */
static hada_fft_filter resolve_filter(const hada_fft *plan, int batch, const hada_fft_filter *filter)
{
    const hada_fft_desc *desc = &plan->desc;
    hada_fft_filter use = {.product = HADA_FFT_PLAIN, .spectrum_count = batch};
    if (filter)
        use = *filter;
    if (!use.stride)
        use.stride = 1;
    const int whole = !use.band_rows && !use.band_cols;
    use.band_rows = whole ? desc->band_rows : hada_least(use.band_rows, desc->band_rows);
    use.band_cols = whole ? desc->band_cols : hada_least(use.band_cols, desc->band_cols);
    return use;
}

hada_status hada_fft_inverse(hada_fft *plan, int batch, cl_mem spectrum, size_t spectrum_offset, cl_mem real,
                             size_t real_offset, const hada_fft_filter *filter, hada_error *err)
{
    HADA_TRY(check_call(plan, HADA_FFT_INVERSE, batch, spectrum_offset, err));
    if (filter && filter->product == HADA_FFT_PLAIN)
        filter = NULL;
    if (filter && (!filter->filter || filter->spectrum_count < 1 || filter->filter_first < 0 || filter->stride < 0 ||
                   filter->band_rows < 0 || filter->band_cols < 0 ||
                   (filter->product != HADA_FFT_COMPLEX && filter->product != HADA_FFT_SPLIT)))
        return hada_fail(err, HADA_ERROR_ARGUMENT, "a filter product needs filters, a form, and one spectrum at least");
    const hada_fft_filter use = resolve_filter(plan, batch, filter);
    return plan->engine->inverse(plan, batch, spectrum, spectrum_offset, real, real_offset, &use, err);
}

hada_status hada_fft_all(hada_fft *plan, int images, cl_mem real, cl_mem spectra, size_t at, hada_error *err)
{
    const hada_fft_desc *desc = &plan->desc;
    for (int first = 0; first < images; first += desc->batch) {
        const int batch = hada_least(images - first, desc->batch);
        const size_t spectrum_at = at + (size_t)first * plan->layout.count,
                     real_at = (size_t)first * desc->real_distance;
        HADA_TRY(desc->direction == HADA_FFT_FORWARD
                     ? hada_fft_forward(plan, batch, real, real_at, spectra, spectrum_at, err)
                     : hada_fft_inverse(plan, batch, spectra, spectrum_at, real, real_at, NULL, err));
    }
    return HADA_OK;
}

/* Which back end serves: the own kernels, unless the tuning file names clFFT. Never a timing. On CPUs the own kernels
 * were three to six times faster than clFFT at every size (perf/results); accelerators have no compiler at run time, so
 * clFFT cannot run there; on GPUs the own kernels prune, and multiply by filters as they read. */

static hada_status try_clfft(hada_slot *slot, hada_fft_direction direction, int rows, int cols, hada_error *err)
{
    hada_fft *plan;
    hada_fft_desc desc = hada_fft_whole(direction, rows, cols, 1);
    desc.backend = HADA_FFT_CLFFT;
    const hada_status status = hada_fft_create(&plan, slot, &desc, err);
    hada_fft_destroy(&plan);
    return status;
}

static hada_status try_both(hada_context *context, int rows, int cols, hada_error *err)
{
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(try_clfft(slot, HADA_FFT_FORWARD, rows, cols, err));
    HADA_TRY_OR_DONE(try_clfft(slot, HADA_FFT_INVERSE, rows, cols, err));
done:
    hada_slot_destroy(&slot);
    return status;
}

/* The list of trials only grows, at its head. */
static const hada_trial *known(hada_context *context, int rows, int cols)
{
    pthread_mutex_lock(&context->lock);
    const hada_trial *trial = context->trials;
    pthread_mutex_unlock(&context->lock);
    while (trial && (trial->rows != rows || trial->cols != cols))
        trial = trial->next;
    return trial;
}

static void remember(hada_context *context, int rows, int cols, int serves)
{
    hada_trial *trial = malloc(sizeof *trial);
    if (!trial) /* it is tried again next time */
        return;
    pthread_mutex_lock(&context->lock);
    *trial = (hada_trial){rows, cols, serves, context->trials};
    context->trials = trial;
    pthread_mutex_unlock(&context->lock);
}

/* Compilers differ, and clFFT writes its text for one of long ago: where a size does not compile, or comes out wrong,
 * the own kernels serve. Tried once for a context and size. */
static int clfft_serves(const hada_context *constant, int rows, int cols)
{
    hada_context *context = (hada_context *)(constant->dry ? constant->dry : constant); /* only its books change */
    const hada_trial *trial = known(context, rows, cols);
    if (trial)
        return trial->works;
    hada_error error = {0};
    const hada_status status = try_both(context, rows, cols, &error);
    const int no_text = status == HADA_ERROR_UNSUPPORTED || status == HADA_ERROR_SELF_TEST;
    if (no_text)
        hada_log(context, HADA_LOG_WARNING, "clFFT does not serve transforms of %d x %d, the own kernels do: %s", rows,
                 cols, error.message);
    if (no_text || status == HADA_OK) /* what else went wrong, such as memory, is for the plan to say */
        remember(context, rows, cols, !no_text);
    return !no_text;
}

hada_fft_backend hada_fft_choose(const hada_context *context, int rows, int cols)
{
    char shape[32];
    snprintf(shape, sizeof shape, "%dx%d", rows, cols);
    const hada_tuning_row *tuned = hada_tuning_find(context, shape);
    if (!tuned || strcmp(tuned->choice, "clfft") != 0)
        return HADA_FFT_OWN;
    const int possible = !context->quirks.avoid_clfft && hada_program_can_compile(context) && hada_clfft_takes(rows) &&
                         hada_clfft_takes(cols) && clfft_serves(context, rows, cols);
    return possible ? HADA_FFT_CLFFT : HADA_FFT_OWN;
}
