/* What the classic methods do, operation by operation. Internal to lib/classic. */
#ifndef HADA_CLASSIC_STEPS_H
#define HADA_CLASSIC_STEPS_H

#include "classic/classic.h"
#include "fft/fft_fused.h"

enum {
    HADA_CLASSIC_BATCH = 48,   /* images that one transform call takes */
    HADA_CLASSIC_SLICE = 2048, /* frequencies or pixels of one work-group: fixes the order of sums on every device */
    HADA_CLASSIC_ROWS = 16,    /* rows that a work-item of classic_rows takes */
    HADA_CLASSIC_GROUP = 64    /* work-items of a group where groups are used; also in the kernels' options */
};

/* The buffers of a hada_classic; a method has those that it needs. "Planes" are images of the support, a depth and
 * channel each; "channels" are images of the frame or spectra, a channel each. */
typedef enum hada_classic_part {
    HADA_CLASSIC_WINDOW,   /* the result */
    HADA_CLASSIC_LIST,     /* depth indices */
    HADA_CLASSIC_PARTIAL,  /* sums of slices */
    HADA_CLASSIC_SPECTRA,  /* of planes; fused: of their rows alone */
    HADA_CLASSIC_SUM,      /* the same of channels: what the planes make of the frame, or leave of it */
    HADA_CLASSIC_X,        /* planes */
    HADA_CLASSIC_SEEN,     /* channels: the frame */
    HADA_CLASSIC_MADE,     /* channels: what the planes make of it */
    HADA_CLASSIC_BEFORE,   /* planes of the iteration before (RL, ADMM) */
    HADA_CLASSIC_START,    /* planes: where an iteration starts (RL, FISTA) */
    HADA_CLASSIC_GRADIENT, /* planes (FISTA) */
    HADA_CLASSIC_NORM,     /* planes (RL) */
    HADA_CLASSIC_TURN,     /* planes: the last direction (RL) */
    HADA_CLASSIC_SMOOTH,   /* planes: result of the TV step (FISTA) */
    HADA_CLASSIC_DUAL,     /* planes x 2: duals of TV (FISTA, ADMM) */
    HADA_CLASSIC_DUAL2,    /* the same: their momentum (FISTA), the next ones (ADMM) */
    HADA_CLASSIC_PYRAMID,  /* planes x levels: means of the wavelets (FISTA) */
    HADA_CLASSIC_SHADOW,   /* planes: dual of non-negativity (ADMM) */
    HADA_CLASSIC_STATE,    /* channels: dual of the data's split (ADMM) */
    HADA_CLASSIC_SPLIT,    /* spectra of channels: what that split adds (ADMM) */
    HADA_CLASSIC_TABLE,    /* steps per channel (FISTA); the gradient's |.|^2 by row and column (ADMM, Wiener) */
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
    int met;   /* the frame's pixels are looked at: HADA_CLASSIC_SEEN, MADE are there */
    int fuses; /* passes are fused: `fused` in place of the transforms below */
    hada_fft_fused fused;
    hada_fft *forward, *inverse;             /* of the support */
    hada_fft *frame_forward, *frame_inverse; /* of the frame, where it is met */
    hada_classic_image plane, frame;
    hada_buffer part[HADA_CLASSIC_PARTS];
    size_t bytes[HADA_CLASSIC_PARTS];
    float *sums; /* on the host */
    const char *spectrum_options, *image_options;
    int group; /* work-items of a group */

    /* of the run in hand */
    const hada_classic_job *job;
    int planes; /* depths x channels */
    double momentum;
    float *table; /* on the host, what goes into HADA_CLASSIC_TABLE */
};

/* Where planes and frame stand on the grid of the transforms. */
hada_refine_rect hada_classic_plane_rect(const hada_classic_shape *shape);
hada_refine_rect hada_classic_frame_rect(const hada_classic_shape *shape);

/* Swaps two buffers of the same size. */
void hada_classic_swap(hada_classic *classic, hada_classic_part a, hada_classic_part b);
hada_status hada_classic_clear(hada_classic *classic, hada_classic_part part, hada_error *err);

/* planes -> HADA_CLASSIC_SPECTRA and back; HADA_CLASSIC_MADE -> spectrum (SUM or SPLIT), HADA_CLASSIC_SUM -> MADE. */
hada_status hada_classic_forward(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_inverse(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_frame_forward(hada_classic *classic, hada_classic_part spectrum, hada_error *err);
hada_status hada_classic_frame_inverse(hada_classic *classic, hada_error *err);

/* HADA_CLASSIC_SUM = sum H X, or (rest) B - sum H X; HADA_CLASSIC_SPECTRA = conj(H) HADA_CLASSIC_SUM. */
hada_status hada_classic_project(hada_classic *classic, int rest, hada_error *err);
hada_status hada_classic_back(hada_classic *classic, hada_error *err);

/* The joint least-squares step of kernels/classic_spectrum.cl. first: HADA_CLASSIC_SPECTRA counts as 0. */
hada_status hada_classic_solve(hada_classic *classic, int first, double m, double mu2, double mu3, hada_error *err);

/* The three parts of an iteration that looks at the frame's pixels, by whole transforms or by fused passes:
 * HADA_CLASSIC_SUM = the frame that planes make; a step on its pixels (HADA_CLASSIC_MADE takes the result) and, where
 * `on`, the result in SUM; planes = transpose of SUM. */
typedef enum hada_classic_meeting {
    HADA_CLASSIC_RATIO = 1, /* y = max(b, 0) / max(y, number); y the prediction, b the frame */
    HADA_CLASSIC_ADMM = 2,  /* the split that meets the data */
    HADA_CLASSIC_REST = 3   /* y = b - y; the kernels know these numbers */
} hada_classic_meeting;
hada_status hada_classic_predict(hada_classic *classic, hada_classic_part planes, hada_error *err);
hada_status hada_classic_judge(hada_classic *classic, hada_classic_meeting mode, double number, int on,
                               hada_error *err);
hada_status hada_classic_transpose(hada_classic *classic, hada_classic_part planes, hada_error *err);

/* HADA_CLASSIC_SEEN = the frame. */
hada_status hada_classic_see(hada_classic *classic, hada_error *err);

/* The step on the pixels alone, on HADA_CLASSIC_MADE. */
hada_status hada_classic_meet(hada_classic *classic, hada_classic_meeting mode, double number, hada_error *err);

/* The fused passes themselves (classic_fused.c). Columns: HADA_CLASSIC_SUM from HADA_CLASSIC_SPECTRA or (back) the
 * other way round. Frame: SUM -> MADE where `inverse`, the step where there is one, MADE -> SUM where `forward`.
 * Planes: SPECTRA -> a part, and back. FISTA: SPECTRA as gradient, classic_momentum, the next start's SPECTRA, all at
 * once. */
hada_status hada_classic_fused_columns(hada_classic *classic, int back, hada_error *err);
hada_status hada_classic_fused_frame(hada_classic *classic, int inverse, int forward, int step, double number,
                                     hada_error *err);
hada_status hada_classic_fused_planes(hada_classic *classic, hada_classic_part planes, int forward, hada_error *err);
hada_status hada_classic_fused_momentum(hada_classic *classic, double beta, hada_error *err);

/* Runs the fused passes once: HADA_ERROR_SELF_TEST where they give wrong results (classic_check.c). */
hada_status hada_classic_check(hada_classic *classic, hada_error *err);

/* Launches a kernel over the rows or the pixels of all planes, in bands or slices. */
hada_status hada_classic_rows(hada_classic *classic, const char *file, const char *name, const hada_arg *args,
                              size_t count, hada_error *err);
hada_status hada_classic_pixels(hada_classic *classic, const char *file, const char *name, const hada_arg *args,
                                size_t count, hada_error *err);

/* The first `count` sums that the last such launch left, `each` partial ones for a plane (rows, pixels, or the fused
 * passes: how many), added up in double; waits. */
size_t hada_classic_bands(const hada_classic *classic);
size_t hada_classic_slices(const hada_classic *classic);
size_t hada_classic_tasks(const hada_classic *classic);
hada_status hada_classic_sums(hada_classic *classic, size_t each, int count, double *sums, hada_error *err);

/* Of HADA_CLASSIC_X, in place: nothing outside the window, nothing negative; HADA_CLASSIC_WINDOW takes the window. */
hada_status hada_classic_crop(hada_classic *classic, hada_error *err);

/* The energy of what HADA_CLASSIC_X does not explain; waits. */
hada_status hada_classic_energy(hada_classic *classic, double *energy, hada_error *err);

/* The gradient's |transfer function|^2 by row and column into the host's table, or zeros. */
void hada_classic_wave(hada_classic *classic, int zero);

/* Each method: what comes before the first iteration; one iteration, which leaves the sums of changes in *sums
 * (squared change, squared size) where `wanted`. ADMM's are those of the iteration before. */
typedef hada_status (*hada_classic_begin_call)(hada_classic *classic, hada_error *err);
typedef hada_status (*hada_classic_step_call)(hada_classic *classic, int number, int wanted, double sums[2],
                                              hada_error *err);
hada_status hada_classic_rl_begin(hada_classic *classic, hada_error *err);
hada_status hada_classic_rl_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err);
hada_status hada_classic_fista_begin(hada_classic *classic, hada_error *err);
hada_status hada_classic_fista_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err);
hada_status hada_classic_admm_begin(hada_classic *classic, hada_error *err);
hada_status hada_classic_admm_step(hada_classic *classic, int number, int wanted, double sums[2], hada_error *err);

#endif
