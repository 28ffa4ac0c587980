/* What the classic methods do, operation by operation. Internal to lib/classic. */
#ifndef HADA_CLASSIC_STEPS_H
#define HADA_CLASSIC_STEPS_H

#include "classic/classic.h"
#include "fft/fft_fused.h"
#include "kernels/shared_classic.h"
#include "launch/classic_spectrum.h"

enum {
    HADA_CLASSIC_BATCH = 48,   /* images that one transform call takes */
    HADA_CLASSIC_SLICE = 2048, /* frequencies or pixels of one work-group: fixes the order of sums on every device */
    HADA_CLASSIC_ROWS = 16     /* rows that a work-item of classic_rows takes */
};

/* The buffers of a hada_classic; a method has those that it needs. "Planes" are images of the support, a depth and
 * channel each; "channels" are images of the frame or spectra, a channel each. */
typedef enum hada_classic_part {
    HADA_CLASSIC_WINDOW,       /* the result */
    HADA_CLASSIC_LIST,         /* indices of transfer functions: depths, or components of depths */
    HADA_CLASSIC_PARTIAL,      /* sums of slices */
    HADA_CLASSIC_SPECTRA,      /* of planes, or of their components; fused: of their rows alone */
    HADA_CLASSIC_COMPONENTS,   /* planes x components: planes times the weights of each (shape.components above 1) */
    HADA_CLASSIC_PROJECTION,   /* the same of channels: what the planes make of the frame, or leave of it */
    HADA_CLASSIC_PRIMAL,       /* planes */
    HADA_CLASSIC_FRAME,        /* channels: the frame */
    HADA_CLASSIC_WEIGHTS,      /* channels: weights of the frame's values */
    HADA_CLASSIC_PREDICTION,   /* channels: what the planes make of it */
    HADA_CLASSIC_PREVIOUS,     /* planes of the iteration before (RL, ADMM) */
    HADA_CLASSIC_EXTRAPOLATED, /* planes: where an iteration starts (RL, FISTA) */
    HADA_CLASSIC_GRADIENT,     /* planes (FISTA) */
    HADA_CLASSIC_NORM,         /* planes (RL) */
    HADA_CLASSIC_DIRECTION,    /* planes: the last direction (RL) */
    HADA_CLASSIC_BLURRED,      /* planes: what Gaussians make of others (RL) */
    HADA_CLASSIC_PROXIMAL,     /* planes: result of the TV step (FISTA) */
    HADA_CLASSIC_TV_DUAL,      /* planes x 2 (FISTA, ADMM) */
    HADA_CLASSIC_TV_DUAL_NEXT, /* the same: their momentum (FISTA), the next ones (ADMM) */
    HADA_CLASSIC_PYRAMID,      /* planes x levels: means of the wavelets (FISTA) */
    HADA_CLASSIC_PLANE_DUAL,   /* planes: dual of non-negativity (ADMM) */
    HADA_CLASSIC_DATA_DUAL,    /* channels: dual of the data's split (ADMM) */
    HADA_CLASSIC_DATA_SPLIT,   /* spectra of channels: what that split adds (ADMM) */
    HADA_CLASSIC_TABLE,        /* steps per channel (FISTA); the gradient's |.|^2 by row and column (ADMM, Wiener); of a
                                  Gaussian (RL) */
    HADA_CLASSIC_PARTS
} hada_classic_part;

/* Images with a pitch. */
typedef struct hada_classic_image {
    int rows, cols, pitch, band; /* band: rows that a work-group takes */
    size_t pixels;               /* rows x pitch */
} hada_classic_image;

struct hada_classic {
    hada_slot *slot;
    hada_classic_shape shape;
    hada_spectrum_layout layout;
    int has_frame; /* the frame's pixels are used: HADA_CLASSIC_FRAME, PREDICTION are there */
    int fuses;     /* passes are fused: `fused` in place of the transforms below */
    hada_fft_fused fused;
    hada_fft_pair fft, frame_fft; /* of the support; of the frame, where it has one */
    hada_classic_image plane, frame;
    hada_buffer part[HADA_CLASSIC_PARTS];
    size_t bytes[HADA_CLASSIC_PARTS];
    float *sums; /* on the host */
    hada_program_classic_spectrum spectrum_program;
    size_t group; /* work-items of a group */

    /* of the run in hand */
    const hada_classic_job *job;
    int planes;    /* depths x channels */
    int weighted;  /* 1: values of the frame have weights: HADA_CLASSIC_WEIGHTS */
    double weight; /* of the prior */
    double sieve;  /* standard deviation of the planes' Gaussians, or 0 */
    double taps;   /* that of the Gaussian in the table, with values up to `reach` */
    int reach;
    double momentum;
    float *table; /* on the host, what goes into HADA_CLASSIC_TABLE */
};

/* Where planes and frame stand on the grid of the transforms. */
hada_rectangle hada_classic_plane_rect(const hada_classic_shape *shape);
hada_rectangle hada_classic_frame_rect(const hada_classic_shape *shape);

/* Swaps two buffers of the same size. */
void hada_classic_swap(hada_classic *classic, hada_classic_part a, hada_classic_part b);
hada_status hada_classic_clear(hada_classic *classic, hada_classic_part part, hada_error *err);
/* The host's table into HADA_CLASSIC_TABLE. */
hada_status hada_classic_write_table(hada_classic *classic, hada_error *err);

/* planes -> HADA_CLASSIC_SPECTRA and back; HADA_CLASSIC_PREDICTION -> spectrum (PROJECTION or DATA_SPLIT),
 * HADA_CLASSIC_PROJECTION -> PREDICTION. */
hada_status hada_classic_forward(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_inverse(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_frame_forward(hada_classic *classic, hada_classic_part spectrum, hada_error *err);
hada_status hada_classic_frame_inverse(hada_classic *classic, hada_error *err);

/* HADA_CLASSIC_PROJECTION = sum H X, or (residual) B - sum H X. */
hada_status hada_classic_project(hada_classic *classic, int residual, hada_error *err);

/* The joint least-squares step of kernels/classic_spectrum.cl. first: HADA_CLASSIC_SPECTRA counts as 0. mu1, mu2, mu3:
 * the weights of data, gradient and planes. */
hada_status hada_classic_solve(hada_classic *classic, int first, double mu1, double mu2, double mu3, hada_error *err);

/* Transfer functions of the job, and images that the transforms take: components count each. */
static inline int hada_classic_terms(const hada_classic *classic)
{
    return classic->job->depths * classic->shape.components;
}

static inline int hada_classic_images(const hada_classic *classic)
{
    return classic->planes * classic->shape.components;
}

/* The three parts of an iteration that uses the frame's pixels, by whole transforms or by fused passes:
 * HADA_CLASSIC_PROJECTION = the frame that planes make; a step on its pixels (HADA_CLASSIC_PREDICTION takes the result)
 * and, where `forward`, the result in PROJECTION; planes = transpose of PROJECTION. */
hada_status hada_classic_predict(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_data_step(hada_classic *classic, hada_classic_pixel_step step, double number, int forward,
                                   hada_error *err);
hada_status hada_classic_transpose(hada_classic *classic, hada_classic_part planes, hada_error *err);

/* HADA_CLASSIC_FRAME or WEIGHTS = an image of the frame's size, from `offset` floats on. */
hada_status hada_classic_load(hada_classic *classic, hada_classic_part part, cl_mem image, size_t offset,
                              hada_error *err);

/* The step on the pixels alone, on HADA_CLASSIC_PREDICTION. */
hada_status hada_classic_step_pixels(hada_classic *classic, hada_classic_pixel_step step, double number,
                                     hada_error *err);

/* Fused passes (kernels/classic_columns.cl, classic_rows.cl). Columns: HADA_CLASSIC_PROJECTION from
 * HADA_CLASSIC_SPECTRA or (transpose) the other way round. FISTA: SPECTRA as gradient, classic_momentum, the next
 * start's SPECTRA, all at once. */
hada_status hada_classic_fused_columns(hada_classic *classic, int transpose, hada_error *err);
hada_status hada_classic_fused_momentum(hada_classic *classic, double beta, hada_error *err);

/* Runs the fused passes once: HADA_ERROR_SELF_TEST where they give wrong results (classic_check.c). */
hada_status hada_classic_check(hada_classic *classic, hada_error *err);

/* Planes as kernels see them, and the work-groups that go over all of them: in bands of rows, or in slices. */
hada_classic_bands hada_classic_plane_bands(const hada_classic *classic);
hada_classic_slices hada_classic_plane_slices(const hada_classic *classic);
hada_range hada_classic_band_range(const hada_classic *classic);
hada_range hada_classic_slice_range(const hada_classic *classic);

/* The first `count` sums that the last such launch left, `each` partial ones for a plane (bands, slices, or the tasks
 * of fused passes: how many), added up in double; waits. */
size_t hada_classic_band_count(const hada_classic *classic);
size_t hada_classic_slice_count(const hada_classic *classic);
size_t hada_classic_task_count(const hada_classic *classic);
hada_status hada_classic_sums(hada_classic *classic, size_t each, int count, double *sums, hada_error *err);

/* Of HADA_CLASSIC_PRIMAL, in place: nothing outside the window, nothing negative; HADA_CLASSIC_WINDOW takes the window.
 */
hada_status hada_classic_crop(hada_classic *classic, hada_error *err);

/* The energy of what HADA_CLASSIC_PRIMAL does not explain of the frame's values, those of weight 0 left out; waits.
 * Where the frame's pixels are used, PRIMAL and what an iteration starts from stay. */
hada_status hada_classic_energy(hada_classic *classic, double *energy, hada_error *err);

/* The gradient's |transfer function|^2 by row and column into the host's table, or zeros. */
void hada_classic_gradient_power(hada_classic *classic, int zero);

/* The prior's weight in the images' own units: it goes with the frame's brightness (docs/explanation/mathematics.md).
 */
double hada_classic_prior_weight(const hada_classic *classic);

/* Everything to begin a run from nothing. */
hada_status hada_classic_ready(hada_classic *classic, const hada_classic_job *job, hada_error *err);

/* Gaussians: BLURRED or another part = G planes. */
enum { HADA_CLASSIC_REACH = 10 };
hada_status hada_classic_blur(hada_classic *classic, double width, hada_classic_part from, hada_classic_part to,
                              hada_error *err);

#endif
