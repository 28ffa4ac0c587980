/* Hadalens: a learned (or measured) camera.
 *
 * A model holds, per depth and channel, a Hadamard filter W on the half spectrum and an estimate of the optical
 * transfer function H, with the conventions they follow. It is immutable once made and may be shared by threads: what
 * changes one gives a copy. Plans and trainers keep the model that they need: it may be destroyed before them.
 * Files are safetensors: docs/reference/files.md names the tensors and the metadata.
 *
 * Geometry. A raw frame has `raw_rows` x `raw_cols` pixels. Transforms run on a grid of `grid_rows` x `grid_cols`:
 * equal to the raw frame for the circular boundary, as a rule larger for the padded one, with the frame in the centre
 * (offset (grid - raw) / 2, rounded down). The scene is the window of `window_rows` x `window_cols` in the centre of
 * the frame (offset (raw - window) / 2, rounded down); outside it the scene is dark. Depths run near to far. */
#ifndef HADALENS_MODEL_H
#define HADALENS_MODEL_H

#include <hadalens/device.h>
#include <hadalens/image.h>
#include <hadalens/net.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* How a filter acts on the frame's spectrum B. Tian and Yang, Optics Express 30(19), 34479 (2022):
 * complex: X = B (Wr + i Wi); split: X = Re(B) Wr + i Im(B) Wi (their Eq. 3);
 * matched: X = B conj(OTF) (Eq. 2); wiener: X = B conj(OTF) / (|OTF|^2 + noise). The last two are complex in use. */
typedef enum hada_form {
    HADA_FORM_AUTO = 0, /* in options only */
    HADA_FORM_COMPLEX = 1,
    HADA_FORM_SPLIT = 2,
    HADA_FORM_MATCHED = 3,
    HADA_FORM_WIENER = 4
} hada_form;

/* circular: the optics' convolution is taken as circular on the frame; padded: it is wider than the sensor, which
 * crops it. */
typedef enum hada_boundary { HADA_BOUNDARY_CIRCULAR = 1, HADA_BOUNDARY_PADDED = 2 } hada_boundary;

typedef struct hada_model hada_model;

typedef struct hada_model_info {
    int depths, channels;
    int raw_rows, raw_cols, grid_rows, grid_cols, window_rows, window_cols;
    hada_form form;
    hada_boundary boundary;
    double alpha, lambda; /* what the fit chose: weight of the other depths, regularisation (relative) */
    double dark;          /* level taken off every pixel before anything else, in units of full scale; HADA_AUTO:
                             each frame's own, estimated */
    double noise;         /* standard deviation of the frame's noise that the fit found, 0 where unknown */
    int refine_steps;     /* refinement that pays for this camera; 0: none does */
    double refine_rho;    /* in units of the largest |OTF(0)|^2 of all depths and channels */
    double refine_tv; /* weight of total variation in it, docs/explanation/refinement.md; 0: none, but the prior that
                         the pairs give; HADA_AUTO: found from each frame */
    int has_otf;
    int half;                       /* filters are kept in half precision */
    int enhance;                    /* 1: it holds a net that enhances refocused planes */
    int enhance_rows, enhance_cols; /* size at which that net runs; 0, 0: the window's */
    uint64_t bytes;                 /* of filters and transfer functions */
    const double *distances_mm;     /* per depth, owned by the model */
    const char *name;               /* file name it was loaded from, or "" */
    double scene_response;          /* how the scenes that it was learned from were encoded (hadalens/response.h); what
                                       it makes of a frame is linear light all the same */
    double refine_colour;           /* in refine_tv, weight of differences of colour over those of brightness, from 1 */
    double refine_share;    /* share of the refined plane where refine_steps recommends refinement and the frame has one
                               depth; the rest is the linear filter's, whose errors are others. 1: all is refined */
    double refine_ridge;    /* with refine_tv: strength of the learned regulariser in the last steps, 1 what photographs
                               favour; 0: none (docs/explanation/refinement.md) */
    hada_mosaic mosaic;     /* frames of one channel are a colour filter mosaic of this pattern; HADA_MOSAIC_NONE: not
                               known to be */
    const hada_image *flat; /* what the pixels of each channel make of the same light, 1 in the mean, 0 where they see
                               hardly any: frames are divided by it. NULL: not known. Owned by the model */
    int downsample;         /* the sensor has so many times the rows and columns: frames of its own size are binned
                               (hada_image_downsample()); 1: it has not */
    hada_mosaic sensor_mosaic; /* of frames of one channel that are binned; HADA_MOSAIC_NONE: not known to be */
    int components; /* above 1: point spread functions vary over the field, b = crop sum_k h_k * (w_k x) with so many
                       components for each depth; filters and transfer functions are then of the mean one. 1: they are
                       the same everywhere */
    int positions;  /* at which they were measured; 0: they do not vary */
    double lost, lost_single; /* share of the measured energy that the components leave, and that the mean alone does;
                                 of the depth with the largest */
    double refine_noise, refine_noise_largest; /* standard deviation of the noise of the frames on which refine_tv was
                                 chosen, over their root mean square and over their largest value: frames with other
                                 noise get other weights; 0: not known */
    const hada_image *dark_frame; /* of all channels: subtracted from each pixel, as `dark` is. NULL: none. Owned by the
                                     model */
    double colour_matrix[9];      /* channel c of the sensor sees colour_matrix[3 c + k] of what channel k of the scenes
                                     makes, in linear light; frames are multiplied by its inverse before anything else,
                                     mosaics once their other colours are filled in. All 0: they see the same colours */
    double frame_encoding;        /* the encoding of frames in files of whole numbers that do not state one
                                     (hadalens/response.h); 0: linear */
} hada_model_info;

HADA_API hada_status hada_model_load(hada_model **out, const char *path, hada_error *err);
HADA_API hada_status hada_model_save(const hada_model *model, const char *path, hada_error *err);
HADA_API void hada_model_destroy(hada_model **model);
HADA_API const hada_model_info *hada_model_get_info(const hada_model *model);

/* The filters W, as they multiply the frame's spectrum, and the transfer functions H: complex numbers (re, im)
 * [depth][channel][grid_rows][grid_cols / 2 + 1], a half spectrum each; of the form split Wr and Wi in their place.
 * docs/reference/files.md has the conventions. Owned by the model. */
typedef struct hada_model_arrays {
    size_t size;                  /* sizeof(hada_model_arrays), set by the caller */
    const float *filters;         /* NULL where they are kept in half precision */
    const uint16_t *half_filters; /* NULL where they are not */
    const float *otf;             /* NULL where the model has no transfer functions */
    /* Of hada_model_info.components above 1, else NULL: transfer functions [depth][component][channel] as above,
     * weights [depth][component][window_rows][window_cols], singular values [depth][positions], descending. */
    const float *component_otf, *component_weights;
    const double *singular_values;
} hada_model_arrays;
HADA_API hada_status hada_model_get_arrays(const hada_model *model, hada_model_arrays *arrays, hada_error *err);

/* Converts the filters to half precision (a copy): a quarter of the memory and traffic less;
 * docs/explanation/learning-a-camera.md states the error. */
HADA_API hada_status hada_model_to_half(hada_model **out, const hada_model *model, hada_error *err);

/* A copy with the fixed filters `matched` or `wiener` made from the model's transfer functions H (HADA_ERROR_MODEL
 * without any): the baselines of a comparison. Matched: conj(H) / |H(0)|^2, which keeps the mean brightness; Wiener:
 * conj(H) / (|H|^2 + lambda mean |H|^2), `lambda` > 0. A net for enhancement, which belongs to the filters that it was
 * trained behind, is left out. */
HADA_API hada_status hada_model_with_form(hada_model **out, const hada_model *model, hada_form form, double lambda,
                                          hada_error *err);

/* A copy with a net (copied) that enhances refocused planes, run at rows x cols (0, 0: the window's size); net NULL: a
 * copy without one. HADA_ERROR_MODEL where the net's channels are not the model's. */
HADA_API hada_status hada_model_with_enhance(hada_model **out, const hada_model *model, const hada_net *net, int rows,
                                             int cols, hada_error *err);

/* The net of a model, owned by it; NULL where it has none. */
HADA_API const hada_net *hada_model_get_enhance(const hada_model *model);

/* How a point spread function is turned about its axis: for images that were taken or saved the other way round. */
typedef enum hada_turn {
    HADA_TURN_NONE = 0,
    HADA_TURN_MIRROR = 1,    /* left to right */
    HADA_TURN_FLIP = 2,      /* top to bottom */
    HADA_TURN_180 = 3,       /* both */
    HADA_TURN_TRANSPOSE = 4, /* rows become columns; then, with those above: */
    HADA_TURN_90 = 5,        /* to the right (clockwise), as seen on a screen */
    HADA_TURN_270 = 6        /* to the left */
} hada_turn;

/* From point spread functions: one image per depth (channels x rows x cols, optical axis at (rows/2, cols/2)), forms
 * matched or wiener. The OTF is kept, so refinement works. They may be smaller than the frame, or larger: then light
 * too far from the axis to reach the frame is left out. */
typedef struct hada_psf_options {
    size_t size;
    hada_form form;               /* HADA_FORM_WIENER by default */
    hada_boundary boundary;       /* HADA_BOUNDARY_PADDED by default: a measured PSF belongs to a sensor that crops */
    int window_rows, window_cols; /* 0: the whole frame */
    double lambda;   /* of the Wiener filter, relative to the mean |OTF|^2, above 0; HADA_AUTO (default): chosen, see
                        docs/explanation/learning-a-camera.md */
    double psf_dark; /* taken off the PSF's pixels; HADA_AUTO (default): estimated from its background */
    double dark;     /* of the frames, not negative, kept in the model; HADA_AUTO: per frame, estimated; 0 by default */
    int refine_steps; /* HADA_AUTO (default): chosen */
    double refine_tv; /* weight of total variation in refinement; 0: none; HADA_AUTO (default): found from each frame */
    hada_turn turn;   /* HADA_TURN_NONE by default: how all of them are turned first */
    hada_mosaic mosaic;         /* of the frames, kept in the model; three channels; HADA_MOSAIC_NONE by default */
    int frame_rows, frame_cols; /* of the frames; 0 (default): the PSFs' size */
    double psf_gate; /* what does not rise above the background by so many standard deviations of its noise is set to 0;
                        0: nothing is; HADA_AUTO (default): chosen; none where psf_dark is 0, as of computed PSFs */
    int psf_taper;   /* pixels over which a PSF fades out towards its borders; 0 by default */
    int downsample;  /* of the frames to come, kept in the model, which bins them by it; the PSFs and frame_rows are of
                        binned pixels, and `mosaic` is that of the sensor; 1 by default */
    /* PSFs that vary over the field: `positions` images for each depth, [depth][position], taken of a point that stands
     * position_rows and position_cols pixels from the middle of its image, [depth][position]. 0 and NULL by default:
     * one image for each depth, the same everywhere. */
    int positions;
    const double *position_rows, *position_cols;
    int components;   /* at most 16; 1: the mean PSF alone; HADA_AUTO (default): as few as explain the share below */
    double explained; /* of the energy of the PSFs of each depth, with HADA_AUTO components; 0.99 by default */
    double colour_matrix[9]; /* of the model; all 0 by default */
} hada_psf_options;
HADA_INIT(hada_psf_options, HADA_STRUCT_PSF_OPTIONS)

HADA_API hada_status hada_model_from_psf(hada_model **out, hada_context *context, const hada_image *psfs, int depths,
                                         const double *distances_mm, const hada_psf_options *options, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
