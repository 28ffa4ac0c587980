/* From a frame to planes: the one way, for reconstruction, for the fit's trials of refinement and for training.
 * Internal.
 *
 * An exposure is a frame on the host, in the form in which it came: checked, examined, its dark level known. A maker
 * has what a device needs to make planes of it: linear filters, or depths that are refined together. */
#ifndef HADA_PLANES_MAKER_H
#define HADA_PLANES_MAKER_H

#include <hadalens/pixels.h>
#include <stdint.h>

#include "filter/hadamard.h"
#include "image/correct.h"
#include "image/statistics.h"
#include "refine/admm.h"

/* What a caller says of frames. */
typedef struct hada_frame_kind {
    hada_mosaic mosaic;        /* of those of one channel; HADA_MOSAIC_AUTO: as the model says */
    int downsample;            /* those of so many times the model's rows and columns are binned; 1: none are */
    hada_mosaic sensor_mosaic; /* of those of one channel that are binned */
} hada_frame_kind;
static const hada_frame_kind hada_frame_plain = {HADA_MOSAIC_NONE, 1, HADA_MOSAIC_NONE};

/* HADA_ERROR_MODEL where a frame has not the size that the model is for. */
hada_status hada_frame_check_size(const hada_model_info *info, const hada_frame_kind *kind, int channels, int rows,
                                  int cols, hada_error *err);

/* A checked frame of the sensor's size is binned into *own, which *pixels becomes then; others leave it empty. */
hada_status hada_frame_bin(hada_pixels *pixels, hada_image *own, const hada_model_info *info,
                           const hada_frame_kind *kind, hada_error *err);

/* How a frame is examined. */
typedef struct hada_exposure_rule {
    int dark_varies; /* 1: each channel of each frame has a dark level of its own; 0: `dark` is that of all */
    double dark;
    const float *dark_frame;    /* subtracted as well, [channel][row][col]; NULL: none */
    const float *pixel_weights; /* as the caller has them, [channel][row][col], 0 to 1; NULL: all 1. Pixels of weight 0
                                   are filled from their neighbours. Of a mosaic, what its pixels hold counts */
    const hada_image *flat; /* what pixels make of the same light (image/correct.h), as pixel_weights, which are 0 where
                          this is; NULL: all alike */
    int bad_pixels;         /* 1: bad pixels are looked for (image/correct.h), and weigh nothing */
    int repairs;            /* 1: pixels that are not finite are repaired from their neighbours; 0: they are an error */
    int energy;             /* 1: the energy is needed */
    int weights;            /* 1: saturated pixels are looked for */
    int hash;               /* 1: the hash is needed */
} hada_exposure_rule;

typedef struct hada_frame_exposure {
    const hada_model_info *info;
    hada_mosaic mosaic;         /* HADA_MOSAIC_NONE: each pixel holds all channels */
    hada_pixels came;           /* the caller's pixels, which must stay, or */
    hada_image binned;          /* what they became; else empty */
    hada_pixels pixels;         /* what goes to the device: these, or `own` */
    hada_image own;             /* floats of pixels that were corrected, or that the device does not take, or whose
                                   other colours were filled in; else empty */
    double *levels;             /* per channel: the dark level; then the one above which it was divided by `flat` */
    float brightest;            /* value, as it came */
    double energy;              /* sum of squares above dark levels and dark frame; of a mosaic, as if each colour were
                                   everywhere what it is at its pixels */
    size_t repaired, saturated; /* pixels */
    size_t *bad, bad_count;     /* values of the frame as it came, [channel][row][col], that were found to be bad */
    const double *stray;        /* what was subtracted beside the scene's light; NULL: nothing */
    const float *dark_frame, *pixel_weights; /* of the rule, as is: */
    const hada_image *flat;
    uint64_t hash[2]; /* of the floats as they came: frames of equal hashes are taken to be equal */
} hada_frame_exposure;

/* Checks the size, and bins a frame of the sensor's. After a failure there is nothing to end. */
hada_status hada_exposure_begin(hada_frame_exposure *exposure, const hada_model_info *info, const hada_frame_kind *kind,
                                const hada_pixels *pixels, hada_error *err);
void hada_exposure_end(hada_frame_exposure *exposure);

/* Reads the frame from memory once, and once more where its dark level has to be known first: pixels that are not
 * finite, the largest value, dark levels, energy, hash. May be called again. HADA_ERROR_NOT_FINITE; HADA_ERROR_NUMERIC
 * where single precision cannot hold the frame's spectrum; HADA_ERROR_MODEL where no pixel is above a dark level. */
hada_status hada_exposure_examine(hada_frame_exposure *exposure, const hada_exposure_rule *rule, hada_error *err);

/* Takes a smooth surface of each channel (image/correct.h) off, until the frame is examined again; `weight` must stay.
 * The energy is measured anew. */
hada_status hada_exposure_subtract(hada_frame_exposure *exposure, const double *weight, hada_error *err);

/* Stray light: a smooth surface of each channel (image/correct.h) without which planes of the given depths of the
 * model, non-negative in the window, explain a frame far better. level_found: 1: the dark levels were found from the
 * frame, and light may be less than they are. weight: [channel][HADA_SMOOTH_TERMS]; *found: 0 where there is none, or
 * the frame is too small to tell. */
hada_status hada_stray_light_find(const hada_frame_exposure *exposure, const hada_model *model, const int *depths,
                                  int count, int level_found, double *weight, int *found, hada_error *err);

/* 1: values of the frame say little or nothing: saturated, repaired, bad, or of a caller's weight. */
int hada_exposure_has_gaps(const hada_frame_exposure *exposure);

/* 1: not all values of the frame are alike. */
int hada_exposure_is_weighted(const hada_frame_exposure *exposure);

/* Weights of the frame's values, as hada_refine_data has them: the caller's or 1, 0 for those that were repaired and
 * for colours that a pixel of a mosaic does not hold, below 0 for saturated ones. Returns how many are above 0. */
size_t hada_exposure_weigh(const hada_frame_exposure *exposure, float *weights);

/* What value i, of all channels, is where it is saturated. */
float hada_exposure_brightest(const hada_frame_exposure *exposure, size_t i);

/* A hash of a few of its pixels as they came: frames whose samples differ are not equal. */
uint64_t hada_exposure_sample(const hada_frame_exposure *exposure);

/* The number of its values, of all channels; their root mean square; its noise's standard deviation and energy; the
 * unit of weights that are proportional to that (image/statistics.h). usual: hada_model_noise_share(), or none. */
size_t hada_exposure_count(const hada_frame_exposure *exposure);
double hada_exposure_noise(const hada_frame_exposure *exposure);
double hada_exposure_noise_energy(const hada_frame_exposure *exposure);
double hada_exposure_light(const hada_frame_exposure *exposure);
double hada_exposure_noise_unit(const hada_frame_exposure *exposure, const hada_noise_share *usual);

/* Single precision holds the spectrum of a frame whose brightest pixel has the size `largest` on a grid of `points`
 * points, and the squares of both: sizes from 2^-40 to 2^63 / points. HADA_ERROR_NUMERIC else. */
hada_status hada_frame_check_range(float largest, double points, hada_error *err);

/* A maker is filled in by its owner, who keeps what it points to. */
typedef struct hada_plane_maker {
    hada_slot *slot;
    const hada_model *model;
    hada_hadamard *stage;         /* takes frames to the device; NULL: the owner fills in `data` */
    const hada_bank *bank;        /* linear filters; NULL: none */
    hada_refiner *refiner;        /* NULL: none */
    hada_refine_data data;        /* of refinement: spectrum and frame (the stage's), transfer functions, prior */
    hada_refine_weights weights;  /* of refinement */
    hada_noise_share noise_share; /* the usual noise; none: weights do not depend on it */
    hada_boundary boundary;       /* of the refiner: padded also where pixels of a circular camera have weights */
    hada_buffer pixels;           /* weights of a frame's pixels, as large as the frame; empty: they have none */
    hada_buffer held;   /* above 0 at held-out pixels, by their weight, else 0; empty: no weight is found from frames */
    hada_buffer blocks; /* a byte for each block of pixels, up to one each: whether it is held out */
} hada_plane_maker;

/* Room for weights of pixels, and with `choose` for finding the weight of total variation from a frame: the latter
 * needs a padded refiner. Freed by hada_maker_free_weights(). */
hada_status hada_maker_make_weights(hada_plane_maker *maker, int choose, hada_error *err);
void hada_maker_free_weights(hada_plane_maker *maker);

/* Brings the weights of a frame's pixels to the device; none where all are equal. */
hada_status hada_maker_weigh(hada_plane_maker *maker, const hada_frame_exposure *exposure, hada_error *err);

/* Steps with the first weight of a sweep, and with the chosen one from nothing; steps at most with which a single depth
 * goes on from there until its plane settles, for all of which the refiner must be made. */
enum { HADA_CHOICE_STEPS = 20, HADA_SETTLING_STEPS = 40 };
/* The fewest steps where many values are saturated: the light that these hide settles slowly. */
enum { HADA_SATURATED_STEPS = 30 };

/* How planes are refined if nobody says otherwise. */
typedef struct hada_maker_way {
    int steps;                   /* 0: not refined */
    int choose;                  /* 1: the weight of total variation is found from frames */
    hada_refine_weights weights; /* tv is 0 with `choose` */
    hada_boundary boundary;      /* of the refiner: held-out pixels need the data step of a sensor that crops */
} hada_maker_way;

/* tv: a weight of total variation; HADA_AUTO: the model's, or found from each frame where it knows none;
 * HADA_REFINE_TV_FRAME: found from each frame. mosaic: of the frames, or none. */
hada_maker_way hada_maker_way_of(const hada_model_info *info, double tv, hada_mosaic mosaic);

/* The weight of total variation that a frame chooses. */
typedef struct hada_maker_choice {
    double tv;
    double factor; /* of the weight, up or down, at which held-out pixels are predicted 1 % worse; 0: not known */
    int steps;     /* of refinement that it took */
} hada_maker_choice;

/* Brings the weights of a frame without held-out pixels, and those of held-out pixels, to the device; blocks of `block`
 * pixels a side are held out (planes/weight_search.h). by_weight: 1: for hada_refine_data.score_mu, an error counts by
 * its value's weight; 0: all alike. hada_maker_weigh() brings all back. */
hada_status hada_maker_hold_out(hada_plane_maker *maker, const hada_frame_exposure *exposure, int block, int by_weight,
                                hada_error *err);

/* What the refiner reads from the maker's stage and bank: transfer functions from `depth` on. */
void hada_maker_use_otf(hada_plane_maker *maker, cl_mem otf, size_t offset, int depths, cl_mem prior);

/* `count` linear planes from depth `first` of the bank, clipped at zero, into `planes` (enqueued). */
hada_status hada_maker_filter(const hada_plane_maker *maker, int first, int count, cl_mem planes, hada_error *err);

/* How far refinement goes. */
typedef struct hada_maker_steps {
    int steps;  /* at most; exactly where stop is 0 */
    int stop;   /* 0: never early; 1: when the residual settles; n > 1: when n planes settle, too */
    int whole;  /* steps of the whole refinement, among which rho of a single depth grows; 0: the model's */
    int before; /* steps that were done before, which these continue, with `stop` until the planes settle */
    double tv;  /* weight of total variation, which rho follows (hada_refine_rule_follow()); 0: the maker's */
    double mu;  /* of the split at the frame, at most (padded); 0: the rule's */
    int resume; /* 1: exactly so many steps, that go on from what the refiner has, as if `before` had been done */
    double firm, hasten; /* with that, rho in units of the usual one, and its growth as of so many steps */
} hada_maker_steps;

/* Refines the planes of `count` depths of the transfer functions together; weights are in `unit`s (of the exposure's
 * noise). *done (may be NULL): the steps. The planes are hada_refiner_planes(). */
hada_status hada_maker_refine(const hada_plane_maker *maker, const hada_maker_steps *steps, double unit, int count,
                              const int *list, int *done, hada_error *err);

/* The same for an exposure, with the weights of its pixels. A maker with held-out pixels finds the weight of total
 * variation if choice->tv is 0; *choice says which one was taken. */
hada_status hada_maker_refine_exposure(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                                       const hada_maker_steps *steps, int count, const int *list,
                                       hada_maker_choice *choice, int *done, hada_error *err);

/* How many of so many steps are those with the learned regulariser: the last three, or half of few; none where the
 * maker has no weight for it, or none of total variation. */
int hada_maker_ridge_steps(const hada_plane_maker *maker, int steps);

/* These steps, after others with the same weight of total variation tv (0: the maker's); adds them to *done. What a
 * frame leaves for the next one is kept before. */
hada_status hada_maker_regularise(const hada_plane_maker *maker, int steps, double tv, int count, const int *list,
                                  int *done, hada_error *err);

/* Of a sequence: what is known of the frame that the refiner remembers (planes/go_on.c). */
typedef struct hada_maker_past {
    double left;   /* share of its energy that its planes leave, which the owner sets once it is known; below 0: none is
                      remembered */
    double least;  /* the least since the scene moved; below 0: it just did */
    double energy; /* of the frame as bright as what is remembered */
    double gain; /* of the current one: it is so many times as bright, and what is remembered became so; 1: no change */
    int steps;   /* that the last frame took that began anew, or that it had to take at most */
    int moved;   /* 1: in the last frame something did */
    int kept;    /* 1: it is the current one */
    int count;   /* its depths */
    int followed; /* frames in a row that took over the depths of the frame before */
    int drifts;   /* 1: in the last frame the scene moved as a whole, so: */
    hada_refine_motion motion;
    int vain;    /* times in a row that it was asked and did not */
    int wait;    /* frames in which that is not asked */
    int ridge;   /* steps with the learned regulariser that this frame needs, at most */
    int asked;   /* of the current frame, 1: it was asked */
    int follows; /* and it did: what is remembered moved as well */
    double now;  /* share of the current frame's energy that its planes leave, once they were recalled; else below 0 */
} hada_maker_past;

/* Whether the planes of the frame before, at the depths `list`, explain this frame as well (*same). Then its depths are
 * the same ones. After two frames in a row the answer is no, so that new depths are found. */
hada_status hada_maker_expects(hada_plane_maker *maker, const hada_frame_exposure *exposure, const int *list,
                               hada_maker_past *past, int *same, hada_error *err);

/* hada_maker_refine_exposure() that goes on from the frame before where that pays (*warm: whether it did), and keeps
 * what it leaves for the next one. */
hada_status hada_maker_go_on(hada_plane_maker *maker, const hada_frame_exposure *exposure,
                             const hada_maker_steps *steps, int count, const int *list, hada_maker_past *past,
                             hada_maker_choice *choice, int *done, int *warm, hada_error *err);

/* Several refined planes fade where others are far brighter: by this share of crosstalk; 0: none does. */
hada_status hada_maker_fade(const hada_plane_maker *maker, int count, double share, hada_error *err);

/* `count` planes from place `first` on of a buffer with planes one after the other, to the host; waits for them. */
hada_status hada_maker_read(const hada_plane_maker *maker, cl_mem planes, int first, int count, float *out,
                            hada_error *err);

#endif
