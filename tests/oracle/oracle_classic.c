/* Runs a reference of tests/ref/ref_classic.h on raw doubles from standard input and writes its planes as raw doubles
 * to standard output, for oracle_classic.py, which computes the same by other means. oracle_classic run METHOD ROWS
 * COLS DEPTHS PADDED FRAME(4) SUPPORT(4) ITERATIONS PRIOR WEIGHT STEP INNER LEVELS ACCELERATE FLAT FLOOR SEEN MU1 MU2
 * MU3 LAMBDA     otf, image oracle_classic tv|haar ROWS COLS WEIGHT INNER|LEVELS PLAIN           image */
#include <string.h>

#include "helpers.h"
#include "oracle_words.h"
#include "ref/ref_classic.h"

static void give_checked(hada_status status, const hada_error *error, double *values, size_t count)
{
    check(status, error);
    give(values, count);
    free(values);
}

static hada_ref_rect rect(void)
{
    hada_ref_rect r;
    r.row0 = whole();
    r.col0 = whole();
    r.rows = whole();
    r.cols = whole();
    return r;
}

static void run(void)
{
    hada_ref_classic p = {.method = (hada_ref_method)whole()};
    hada_error error = {0};
    p.rows = whole();
    p.cols = whole();
    p.depths = whole();
    p.padded = whole();
    p.frame = rect();
    p.support = rect();
    p.iterations = whole();
    p.prior = (hada_ref_prior)whole();
    p.weight = number();
    p.step = number();
    p.inner = whole();
    p.levels = whole();
    p.accelerate = whole();
    p.flat = number();
    p.floor = number();
    p.seen = number();
    p.mu1 = number();
    p.mu2 = number();
    p.mu3 = number();
    p.lambda = number();
    const size_t pixels = (size_t)p.rows * (size_t)p.cols, depths = (size_t)p.depths;
    SCOPED_MEMORY double *otf = take(depths * 2 * (size_t)p.rows * (size_t)(p.cols / 2 + 1)), *image = take(pixels);
    double *planes = room(depths * pixels);
    p.otf = otf;
    p.image = image;
    give_checked(hada_ref_classic_run(&p, planes, NULL, &error), &error, planes, depths * pixels);
}

static void proximal(int tv)
{
    hada_error error = {0};
    const int rows = whole(), cols = whole();
    const double weight = number();
    const int count = whole(), plain = whole();
    const size_t pixels = (size_t)rows * (size_t)cols;
    double *image = take(pixels), *duals = room(2 * pixels);
    const hada_status status = tv ? hada_ref_tv(image, duals, rows, cols, weight, count, &error)
                                  : hada_ref_haar(image, rows, cols, weight, count, plain, &error);
    give_checked(status, &error, image, pixels);
    free(duals);
}

int main(int argc, char **argv)
{
    if (argc < 3)
        quit("what to do?");
    words = argv + 2;
    if (!strcmp(argv[1], "run"))
        run();
    else
        proximal(!strcmp(argv[1], "tv"));
    return 0;
}
