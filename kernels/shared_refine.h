/* Constants and structs of the refinement, for kernels and host. */
#ifndef SHARED_REFINE_H
#define SHARED_REFINE_H

#include "shared_spectrum.h"

/* Where a run starts. */
typedef enum hada_refine_start {
    HADA_REFINE_COLD = 0,    /* from nothing */
    HADA_REFINE_WARM = 1,    /* from the planes that hada_refiner_planes() holds, duals zero */
    HADA_REFINE_CONTINUE = 2 /* from planes and duals as the last run left them */
} hada_refine_start;

/* Sums over slices of frequencies or pixels: partial[first + image * slices + slice]. */
typedef struct hada_refine_sums {
    unsigned int slice; /* values of one slice */
    unsigned int first;
} hada_refine_sums;
HADA_SHARED_SIZE(hada_refine_sums, 8)

/* The problem of a set: OTFs as [depth][channel][count], the frame's spectrum as [channel][count]. */
typedef struct hada_refine_problem {
    hada_ulong otf_offset, frame_offset; /* in complex numbers */
    hada_spectrum_shape spectrum;
    int depths; /* of a set */
    unsigned int channels;
    hada_refine_sums sums; /* where energies go */
} hada_refine_problem;
HADA_SHARED_SIZE(hada_refine_problem, 48)

/* A linear step. */
typedef struct hada_refine_step {
    hada_refine_problem problem;
    hada_ulong split; /* where A stands behind W and E behind U, in complex numbers */
    float rho;
    float keep; /* the last step's rho over this one's: the dual is scaled by rho */
    float relaxation;
    int start;  /* hada_refine_start: cold, warm (no dual yet) or a further step */
    int padded; /* the sensor crops: the data are the split's */
    int has_prior;
} hada_refine_step;
HADA_SHARED_SIZE(hada_refine_step, 80)

/* The frequencies of a score. */
typedef struct hada_refine_band {
    unsigned int rows, cols; /* frequencies with 2 |ky| < rows and 2 |kx| < cols */
    int has_prior, has_variance;
} hada_refine_band;
HADA_SHARED_SIZE(hada_refine_band, 16)

/* A score from half spectra of rows (refine_group_score.cl). */
typedef struct hada_refine_scoring {
    hada_refine_problem problem;
    hada_refine_band band;
    int row0, rows; /* the window's rows on the grid */
    int width;      /* columns side by side, a power of two up to 8 */
    int table;      /* where the transform's table stands behind the list of depths, in numbers */
} hada_refine_scoring;
HADA_SHARED_SIZE(hada_refine_scoring, 80)

/* Images at another place (refine_move.cl): weights of the pixels from (row, col) after a pixel on. */
#define HADA_REFINE_MOVE_TAPS 6
typedef struct hada_refine_move {
    int rows, cols, row, col;
    float down[HADA_REFINE_MOVE_TAPS], across[HADA_REFINE_MOVE_TAPS];
    float least; /* that a pixel becomes */
} hada_refine_move;
HADA_SHARED_SIZE(hada_refine_move, 68)

/* How much each pixel of the 5 x 5 around a pixel adds to the light there. */
#define HADA_REFINE_MOVE_AROUND 0.002f

/* The step from spectra to those of a coarser grid. */
typedef struct hada_refine_crop {
    int parts;    /* 2: complex values, 1: real ones */
    int channels; /* of an image that is read; one is written */
    float factor;
    float tapers; /* times that a Gaussian window is applied; negative: divided out */
    int invert;   /* 1 / the result is written */
} hada_refine_crop;
HADA_SHARED_SIZE(hada_refine_crop, 20)

/* Pixels that an item of refine_dct_colours takes in lanes; a multiple of eight. */
#define HADA_REFINE_DCT_RUN 128

/* Steps of a pass along rows (refine_rows.cl, refine_frame_rows.cl, refine_group_rows.cl), in the order in which they
 * are done; a pass has one or several of them. */
typedef enum hada_refine_pass {
    HADA_REFINE_TO_PIXELS = 1, /* pixels from the half spectra, else they are read as they are */
    HADA_REFINE_CLIP = 2,      /* negative pixels become 0 */
    HADA_REFINE_TO_SPECTRA = 4 /* half spectra from the pixels */
} hada_refine_pass;

/* A pass along the rows of a rectangle of the grid: the window, or the frame where a sensor crops. */
typedef struct hada_refine_rows {
    int row0, rows, col0, cols;
    int pass;       /* of hada_refine_pass */
    float scale;    /* of the inverse transform */
    int back_table; /* lanes: where the inverse transform's table begins in that of both, in numbers */
    int width;      /* groups: transforms side by side, a power of two */
} hada_refine_rows;
HADA_SHARED_SIZE(hada_refine_rows, 32)

/* A linear step along columns (refine_columns.cl, refine_group_columns.cl, refine_odd_columns.cl). */
typedef struct hada_refine_columns {
    hada_refine_step step;
    int row0, rows;             /* the window's rows on the grid */
    int frame_row0, frame_rows; /* where a sensor crops: the frame's */
    int width;                  /* groups: columns side by side, a power of two up to 8 */
    int table;                  /* where the transform's table stands behind the list of depths, in numbers */
} hada_refine_columns;
HADA_SHARED_SIZE(hada_refine_columns, 104)

/* The data step where a sensor crops, along the frame's rows (refine_frame_rows.cl, refine_group_rows.cl). */
typedef struct hada_refine_data_step {
    hada_ulong at;           /* where half spectra stand, in complex numbers */
    hada_ulong frame_offset; /* in floats */
    unsigned int channels;
    unsigned int sums; /* the first of them */
    float scale;       /* of the differences: 1 / (1 + mu); where pixels have weights 1 */
    float mu;          /* with weights */
    int has_weights;
    int first_group; /* groups: number of the first work-group that takes rows of the frame */
} hada_refine_data_step;
HADA_SHARED_SIZE(hada_refine_data_step, 40)

/* The same over pixels (refine_frame of refine.cl). */
typedef struct hada_refine_frame_step {
    hada_ulong frame_offset; /* in floats */
    unsigned int channels, pixels;
    int use_frame, has_weights;
    float scale, mu;
    hada_refine_sums sums;
} hada_refine_frame_step;
HADA_SHARED_SIZE(hada_refine_frame_step, 40)

/* A pass along rows of the planes and, by other work-groups of the same launch, of the frame (refine_group_rows.cl). */
typedef struct hada_refine_rows_pair {
    hada_refine_data_step data;
    hada_refine_rows planes, frame;
} hada_refine_rows_pair;
HADA_SHARED_SIZE(hada_refine_rows_pair, 104)

/* Work-items of a group of these, by work-groups. */
#define HADA_REFINE_FUSED_GROUP 256
/* The same where the last stage is of radix 43: that many items have a butterfly of two depths' columns each, and
 * registers for it. */
#define HADA_REFINE_ODD_GROUP 128

/* Planes of the window, in bands of rows. */
typedef struct hada_refine_window {
    int channels, rows, cols;
    int band; /* rows of a work-group */
} hada_refine_window;
HADA_SHARED_SIZE(hada_refine_window, 16)

/* Steps of total variation in one pass (refine_tv_rows.cl), and the columns that tiles overlap by at either side. */
#define HADA_REFINE_TV_ROWS_STEPS  3
#define HADA_REFINE_TV_ROWS_MARGIN 8
#define HADA_REFINE_TV_ROWS_ROOM   808

typedef struct hada_refine_tv_rows {
    hada_refine_window window;
    int tiles, inner; /* of a row: tiles, and columns of each without its halo, a multiple of eight */
    int fresh;        /* the duals are taken as 0 */
} hada_refine_tv_rows;
HADA_SHARED_SIZE(hada_refine_tv_rows, 28)

/* Steps of total variation on tiles (refine_tv_tile.cl): square tiles of that many pixels a side with their halo, by
 * groups of that many work-items. Three channels of a tile take 24 KiB of local memory. */
#define HADA_REFINE_TV_TILE  32
#define HADA_REFINE_TV_GROUP 256

typedef struct hada_refine_tv_tile {
    hada_ulong copy; /* where the copy of the planes stands behind the duals, in numbers */
    int rows, cols;
    int steps;              /* of the launch */
    int fresh, first, last; /* the duals are taken as 0; which launch of a proximal step it is */
} hada_refine_tv_tile;
HADA_SHARED_SIZE(hada_refine_tv_tile, 32)

#endif
