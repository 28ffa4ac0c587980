/* The clFFT back end. */
#include "fft/fft_internal.h"

int hada_clfft_takes(int n)
{
    (void)n;
    return 0;
}

static hada_status clfft_create(hada_fft *plan, hada_error *err)
{
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "clFFT does not take %d x %d: leave the choice to the table",
                     plan->desc.rows, plan->desc.cols);
}

static void clfft_destroy(hada_fft *plan)
{
    (void)plan;
}

static size_t clfft_bytes(const hada_context *context, const hada_fft_desc *desc)
{
    (void)context;
    (void)desc;
    return 0;
}

static int clfft_block(const hada_context *context, int rows, int cols)
{
    (void)context;
    (void)rows;
    return cols / 2 + 1;
}

const hada_fft_engine hada_fft_clfft_engine = {
    clfft_create, clfft_destroy, NULL, NULL, clfft_bytes, clfft_block,
};
