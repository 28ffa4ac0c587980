/* The contents of a model, and the places of frame and window on its grid. Internal. */
#ifndef HADA_MODEL_MODEL_H
#define HADA_MODEL_MODEL_H

#include <hadalens/model.h>
#include <stdatomic.h>

#include "image/colour_matrix.h"
#include "image/statistics.h"
#include "io/safetensors.h"

/* Of point spread functions that vary over the field. */
enum { HADA_MOST_COMPONENTS = 16, HADA_MOST_POSITIONS = 1024 };
/* Of refinement, and of alpha and lambda: more is a damaged number, or leaves nothing of the filters. */
enum { HADA_MODEL_MOST_STEPS = 1000000 };
#define HADA_MODEL_MOST_WEIGHT 1e30

/* Filters and transfer functions are kept on the host as row-major half spectra: complex numbers
 * [depth][channel][grid_rows][grid_cols / 2 + 1], re and im interleaved. One of `filter` and `filter_half` is NULL. */
struct hada_model {
    hada_model_info info;
    double *distances;
    char *name;
    float *filter;
    uint16_t *filter_half;
    float *otf; /* NULL where has_otf is 0 */
    /* What the fit knows of scenes and noise, for refinement; both NULL in a model made from point spread functions.
     * scene_power: mean |X|^2 over all pairs, depths and channels, [grid_rows][grid_cols / 2 + 1];
     * noise_power: mean over frequencies of the noise's |N|^2, [depth][channel]; pairs: number of pairs, [depth]. */
    float *scene_power;
    double *noise_power;
    double *pairs;
    /* Of info.components above 1, as hada_model_arrays has them; else NULL. */
    float *component_otf, *component_weights;
    double *singular_values;
    hada_image flat, dark_frame; /* of info; empty: none */
    hada_net *enhance;           /* may be NULL */
    atomic_int holders;          /* besides its maker: hada_model_hold() */
    void *file; /* non-NULL: the large arrays are in this opened file (hada_tensors), not freed one by one */
};

/* Places on the grid, in pixels from its top left. */
typedef struct hada_geometry {
    int raw_row, raw_col;       /* of the frame */
    int window_row, window_col; /* of the window */
} hada_geometry;

/* Computed from a model's sizes; HADA_ERROR_MODEL if they do not fit into one another. */
hada_status hada_geometry_of(const hada_model_info *info, hada_geometry *out, hada_error *err);

/* Checks and fills the sizes of an info from raw and window sizes (window 0 x 0: the whole frame) and the boundary: the
 * grid of a padded model holds a linear correlation of frame and window, raw + window - 1, at a size that transforms
 * well. */
hada_status hada_model_set_sizes(hada_model_info *info, int raw_rows, int raw_cols, int window_rows, int window_cols,
                                 hada_error *err);

/* The largest |OTF(0)|^2 of all depths and channels: the unit of refine_rho. 1 without transfer functions. */
double hada_model_gain(const hada_model *model);

/* The mean |OTF|^2 of one depth and channel over the whole grid. */
double hada_model_mean_square(const float *otf, const hada_model_info *info);

/* Its point spread function's autocorrelation over the sum of those at the eight nearest shifts: 0.33 for a Gaussian of
 * standard deviation 0.6 pixels, 1 for one of 0.4, infinite for single pixels; noise makes it larger. */
double hada_model_sharpness(const float *otf, const hada_model_info *info);

/* W from H: matched conj(H) / |H(0)|^2, which keeps the mean brightness; Wiener conj(H) / (|H|^2 + floor), where
 * the floor is lambda mean|H|^2. */
void hada_model_make_filter(const float *otf, size_t plane, hada_form form, double floor, float *filter);

/* The noise of the frames on which the weights of a model were chosen. Where it does not say, that of the frames that
 * it was learned from, by its transfer functions, which are read, and the scenes' power; none where it knows of no
 * noise. */
hada_noise_share hada_model_noise_share(const hada_model *model);

/* Transfer functions of all components, and values of their weights. */
size_t hada_model_component_images(const hada_model_info *info);
size_t hada_model_component_weights(const hada_model_info *info);

/* Number of complex values of one depth and channel. */
size_t hada_model_plane(const hada_model *model);
size_t hada_model_info_plane(const hada_model_info *info);

/* A model with room for everything its info says, zeroed; distances are copied. `with_statistics` makes room for
 * scene_power, noise_power and pairs as well. */
hada_status hada_model_create(hada_model **out, const hada_model_info *info, int with_statistics, hada_error *err);

/* The same with a copy of the transfer functions of `model`, and of its fit's statistics of scenes and noise. */
hada_status hada_model_create_like(hada_model **out, const hada_model *model, const hada_model_info *info,
                                   hada_error *err);

/* The model, for who uses it after its maker may have destroyed it; hada_model_destroy() ends this. From then on nobody
 * changes it. */
hada_model *hada_model_hold(const hada_model *model);

/* As hada_model_create, without the arrays that a file may supply (filter, filter_half, otf, scene_power). */
hada_status hada_model_create_head(hada_model **out, const hada_model_info *info, hada_error *err);

/* 1: rows and columns of a frame are `downsample` times those of the model's frames, or a few more. */
static inline int hada_is_of_sensor(const hada_model_info *info, int downsample, int rows, int cols)
{
    return downsample > 1 && rows / downsample == info->raw_rows && cols / downsample == info->raw_cols;
}

/* Gives it a copy of what pixels make of the same light (hada_model_info.flat), of all its channels or one for all, of
 * the size of its frames or of its sensor; NULL: none. HADA_ERROR_SIZE. */
hada_status hada_model_set_flat(hada_model *model, const hada_image *flat, hada_error *err);
/* The same for what frames hold without the scene's light (hada_model_info.dark_frame). */
hada_status hada_model_set_dark(hada_model *model, const hada_image *dark, hada_error *err);

/* HADA_ERROR_MODEL where PSFs vary over the field: for what takes them for the same everywhere, `what`. */
hada_status hada_model_check_single(const hada_model_info *info, const char *what, hada_error *err);

/* Gives a model a net, which becomes its own (also on failure), with the size at which it runs. */
hada_status hada_model_own_enhance(hada_model *model, hada_net *net, int rows, int cols, hada_error *err);

/* Converts the values of a filter to half precision. HADA_ERROR_NUMERIC where one is too large for half, or where so
 * many are below its normal numbers that the filter changes by more than half's 2^-11 (relative L2). */
hada_status hada_filter_to_half(const float *filter, size_t values, uint16_t *half, hada_error *err);

/* Whether it can be an alpha or a lambda; the same of options, where HADA_AUTO has it chosen, and no other number. */
static inline int hada_model_weight_is_known(double value)
{
    return value >= 0.0 && value <= HADA_MODEL_MOST_WEIGHT;
}

static inline int hada_model_weight_is_given(double value)
{
    return value == HADA_AUTO || hada_model_weight_is_known(value);
}

/* Whether an info makes sense: counts, sizes, numbers, distances in order. Messages begin with "the model". */
hada_status hada_model_info_check(const hada_model_info *info, hada_error *err);

/* Whether pictures can come from the numbers of a model's tensors: HADA_ERROR_MODEL where some are NaN, infinite,
 * negative powers, nothing but 0, or beyond what single precision bears. Reads each once. */
hada_status hada_model_check_numbers(const hada_model *model, hada_error *err);

/* Write and read what files of models and of sums say about frames: frame_encoding, colour_matrix, mosaic,
 * sensor_mosaic, downsample. A key is left out where the camera has no such thing. Reading returns the first key with
 * a wrong value, or NULL. */
hada_status hada_model_put_frames(hada_tensors_writer *writer, const hada_model_info *info, hada_error *err);
const char *hada_model_get_frames(const hada_tensors *file, hada_model_info *info);

/* The words of forms and boundaries in files, and back (0 where unknown). */
const char *hada_form_name(hada_form form);
const char *hada_boundary_name(hada_boundary boundary);
hada_form hada_form_from_name(const char *name);
hada_boundary hada_boundary_from_name(const char *name);

#endif
