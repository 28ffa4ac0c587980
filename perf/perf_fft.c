/* Times the transforms against FFTW (two threads, FFTW_MEASURE) and, when asked for, clFFT: batches of real images,
 * both directions, and the pruned inverse with a filter product that the reconstruction consists of. Peers take turns,
 * so that a busy machine slows them alike. Printed are medians and minima, and three ratios: the median of those round
 * by round, that of the minima, and that of the processor time of all threads (medians), which other jobs disturb
 * least.
 *
 *     perf_fft [--clfft] [--rounds N] [--threads N] [CASE...]        cases: 256 few 512 1024 paper window half
 */
#include <fftw3.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "fft/fft.h"

#define MOST_ROUNDS 1000

static hada_error err;
static hada_context *context;
static hada_slot *slot;
static int rounds = 40, threads = 2, with_clfft;

static void must(hada_status status)
{
    if (status) {
        fprintf(stderr, "perf_fft: %s\n%s\n", err.message, err.detail);
        exit(1);
    }
}

static double seconds_of(clockid_t clock)
{
    struct timespec t;
    clock_gettime(clock, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double seconds(void)
{
    return seconds_of(CLOCK_MONOTONIC);
}

static int compare(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, compare);
    return values[count / 2];
}

/* Host memory as the library's buffers have it: aligned, in huge pages where the system gives them. */
static float *pages(size_t floats)
{
    const size_t huge = (size_t)2 << 20, bytes = (floats * sizeof(float) + huge - 1) / huge * huge;
    void *memory = aligned_alloc(huge, bytes);
    if (!memory)
        exit(1);
    madvise(memory, bytes, MADV_HUGEPAGE);
    unsigned state = 1;
    for (size_t i = 0; i < bytes / sizeof(float); i++) {
        state = state * 1664525u + 1013904223u;
        ((float *)memory)[i] = (float)(state >> 8) / 8388608.0f - 1.0f;
    }
    return memory;
}

typedef struct device_side {
    hada_fft *plan;
    hada_buffer real, spectrum;
} device_side;

static device_side make_side(hada_fft_desc desc, hada_fft_backend backend)
{
    device_side side = {0};
    desc.backend = backend;
    const hada_status status = hada_fft_create(&side.plan, slot, &desc, &err);
    if (status == HADA_ERROR_UNSUPPORTED) /* clFFT's lengths; the plan stays NULL */
        return side;
    must(status);
    const size_t floats = desc.real_distance * (size_t)desc.batch;
    const size_t spectrum = hada_fft_plan_layout(side.plan)->count * (size_t)desc.batch * 2;
    float *values = pages(spectrum > floats ? spectrum : floats);
    must(hada_buffer_create_from(&side.real, slot, values, floats * sizeof(float), "images", &err));
    must(hada_buffer_create_from(&side.spectrum, slot, values, spectrum * sizeof(float), "spectra", &err));
    free(values);
    return side;
}

static void run_side(const device_side *side, const hada_fft_desc *desc)
{
    if (desc->direction == HADA_FFT_FORWARD)
        must(hada_fft_forward(side->plan, desc->batch, side->real.mem, 0, side->spectrum.mem, 0, &err));
    else
        must(hada_fft_inverse(side->plan, desc->batch, side->spectrum.mem, 0, side->real.mem, 0, NULL, &err));
    must(hada_slot_finish(slot, &err));
}

static void free_side(device_side *side)
{
    hada_fft_destroy(&side->plan);
    hada_buffer_destroy(&side->real);
    hada_buffer_destroy(&side->spectrum);
}

typedef struct timing {
    double wall[MOST_ROUNDS], processor[MOST_ROUNDS];
} timing;

/* Runs one side, or FFTW's plan, and notes its times. */
static void run(const device_side *side, const hada_fft_desc *desc, fftwf_plan plan, timing *times, int round)
{
    const double start = seconds(), used = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
    if (side)
        run_side(side, desc);
    else
        fftwf_execute(plan);
    const int at = round < 0 ? 0 : round;
    times->processor[at] = seconds_of(CLOCK_PROCESS_CPUTIME_ID) - used;
    times->wall[at] = seconds() - start;
}

static void report(const char *name, timing own, timing peer, const char *peer_name)
{
    double ratios[MOST_ROUNDS];
    for (int i = 0; i < rounds; i++)
        ratios[i] = own.wall[i] / peer.wall[i];
    const double own_median = median(own.wall, rounds), peer_median = median(peer.wall, rounds);
    printf("%-22s own %8.3f (%8.3f) ms   %-5s %8.3f (%8.3f) ms   own/%s %.2f, minima %.2f, processor %.2f\n", name,
           own_median * 1e3, own.wall[0] * 1e3, peer_name, peer_median * 1e3, peer.wall[0] * 1e3, peer_name,
           median(ratios, rounds), own.wall[0] / peer.wall[0],
           median(own.processor, rounds) / median(peer.processor, rounds));
    fflush(stdout);
}

static void compare_case(int rows, int cols, int batch, hada_fft_direction direction)
{
    const int inverse = direction == HADA_FFT_INVERSE, size[2] = {rows, cols};
    const size_t real = (size_t)rows * (size_t)cols, half = (size_t)rows * (size_t)(cols / 2 + 1);
    char name[64];
    snprintf(name, sizeof name, "%s %dx%d x%d", inverse ? "inverse" : "forward", rows, cols, batch);
    hada_fft_desc desc = hada_fft_whole(direction, rows, cols, batch);
    float *a = pages(real * (size_t)batch), *b = pages(2 * half * (size_t)batch);
    fftwf_plan plan = inverse ? fftwf_plan_many_dft_c2r(2, size, batch, (fftwf_complex *)b, NULL, 1, (int)half, a, NULL,
                                                        1, (int)real, FFTW_MEASURE)
                              : fftwf_plan_many_dft_r2c(2, size, batch, a, NULL, 1, (int)real, (fftwf_complex *)b, NULL,
                                                        1, (int)half, FFTW_MEASURE);
    memset(a, 0, real * (size_t)batch * sizeof *a); /* c2r overwrites its input: zeros keep it finite */
    memset(b, 0, 2 * half * (size_t)batch * sizeof *b);
    device_side own = make_side(desc, HADA_FFT_OWN), peer = {0};
    if (with_clfft)
        peer = make_side(desc, HADA_FFT_CLFFT);
    static timing own_times, fftw_times, clfft_times;
    for (int i = -3; i < rounds; i++) {
        run(&own, &desc, NULL, &own_times, i);
        run(NULL, &desc, plan, &fftw_times, i);
        if (peer.plan)
            run(&peer, &desc, NULL, &clfft_times, i);
    }
    report(name, own_times, fftw_times, "FFTW");
    if (peer.plan) {
        report(name, own_times, clfft_times, "clFFT");
        free_side(&peer);
    }
    free_side(&own);
    fftwf_destroy_plan(plan);
    free(a);
    free(b);
}

/* The reconstruction of the reference workload paper2022: 14 depths of an RGB frame, a window of 383 x 383. */
static void window_case(int half)
{
    const int channels = 3, depths = 14, batch = channels * depths, window = 383;
    const hada_rectangle part = {(1376 - window) / 2, (2064 - window) / 2, window, window};
    hada_fft_desc desc = hada_fft_of(HADA_FFT_INVERSE, 1376, 2064, batch, part);
    hada_buffer real, spectrum, filter;
    hada_fft *plan;
    static timing times;
    must(hada_fft_create(&plan, slot, &desc, &err));
    const size_t count = hada_fft_plan_layout(plan)->count, one = count * (half ? 4 : 8);
    must(hada_buffer_create(&real, context, desc.real_distance * (size_t)batch * sizeof(float), "images", &err));
    must(hada_buffer_create(&spectrum, context, count * (size_t)channels * 8, "spectra", &err));
    must(hada_buffer_create(&filter, context, one * (size_t)batch, "filters", &err));
    float *values = pages(count * (size_t)channels * 2);
    if (half)
        memset(values, 0x2c, one); /* every half 0.0644 */
    for (int i = 0; i < batch; i++)
        must(hada_buffer_write(&filter, slot, (size_t)i * one, values, one, &err));
    free(values);
    values = pages(count * (size_t)channels * 2);
    must(hada_buffer_write(&spectrum, slot, 0, values, count * (size_t)channels * 8, &err));
    const hada_fft_filter product = {
        .product = HADA_FFT_COMPLEX, .filter = filter.mem, .half = half, .spectrum_count = channels};
    for (int i = -2; i < rounds; i++) {
        const double start = seconds(), used = seconds_of(CLOCK_PROCESS_CPUTIME_ID);
        must(hada_fft_inverse(plan, batch, spectrum.mem, 0, real.mem, 0, &product, &err));
        must(hada_slot_finish(slot, &err));
        times.wall[i < 0 ? 0 : i] = (seconds() - start) / batch;
        times.processor[i < 0 ? 0 : i] = (seconds_of(CLOCK_PROCESS_CPUTIME_ID) - used) / batch;
    }
    const double middle = median(times.wall, rounds), processor = median(times.processor, rounds);
    printf("window 383x383 of 1376x2064 x%d, %s filters: %.3f (%.3f) ms a plane, processor %.3f (%.3f) ms\n", batch,
           half ? "half" : "float", middle * 1e3, times.wall[0] * 1e3, processor * 1e3, times.processor[0] * 1e3);
    hada_fft_destroy(&plan);
    hada_buffer_destroy(&real);
    hada_buffer_destroy(&spectrum);
    hada_buffer_destroy(&filter);
    free(values);
}

int main(int argc, char **argv)
{
    static const struct {
        const char *name;
        int rows, cols, batch;
    } cases[] = {{"256", 256, 256, 42},
                 {"few", 256, 256, 3},
                 {"512", 512, 512, 42},
                 {"1024", 1024, 1024, 3},
                 {"paper", 1376, 2064, 3}};
    int first = 1;
    for (; first < argc && !strncmp(argv[first], "--", 2); first++) {
        if (!strcmp(argv[first], "--clfft"))
            with_clfft = 1;
        else if (!strcmp(argv[first], "--rounds") && first + 1 < argc)
            rounds = atoi(argv[++first]);
        else if (!strcmp(argv[first], "--threads") && first + 1 < argc)
            threads = atoi(argv[++first]);
    }
    if (rounds < 1 || rounds > MOST_ROUNDS)
        rounds = 40;
    must(hada_context_create(&context, NULL, &err));
    must(hada_slot_create(&slot, context, &err));
    printf("%s; median (minimum) of %d rounds; FFTW with %d threads, FFTW_MEASURE\n",
           hada_context_device(context)->name, rounds, threads);
    fftwf_init_threads();
    fftwf_plan_with_nthreads(threads);
    for (int c = 0; c < 7; c++) {
        const char *name = c < 5 ? cases[c].name : c == 5 ? "window" : "half";
        int wanted = first == argc;
        for (int i = first; i < argc; i++)
            wanted |= !strcmp(argv[i], name);
        if (!wanted)
            continue;
        if (c >= 5) {
            window_case(c == 6);
            continue;
        }
        compare_case(cases[c].rows, cases[c].cols, cases[c].batch, HADA_FFT_FORWARD);
        compare_case(cases[c].rows, cases[c].cols, cases[c].batch, HADA_FFT_INVERSE);
    }
    hada_slot_destroy(&slot);
    hada_context_destroy(&context);
    fftwf_cleanup_threads();
    return 0;
}
