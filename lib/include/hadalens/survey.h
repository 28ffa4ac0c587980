/* Hadalens: what pairs say before a camera is learned from them: how their scenes are encoded, and whether their frames
 * were exposed alike.
 *
 * On reduced copies (some thirty pixels a side) the frame of each pair in turn is explained by a convolution that is
 * learned from the other pairs of its depth. The response of the scenes with which least is left unexplained is theirs;
 * where evidence lies within its spread, scenes stay linear. A frame that was exposed longer than others of its depth
 * (automatic exposure) is explained up to a factor, which is found as well. docs/explanation/learning-a-camera.md tells
 * the method.
 *
 * On the host, without a device. Threads: no state; a survey does not change once it was made. */
#ifndef HADALENS_SURVEY_H
#define HADALENS_SURVEY_H

#include <hadalens/fit.h>
#include <hadalens/response.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What is known of the exposure of the frames of a depth. */
typedef enum hada_exposure {
    HADA_EXPOSURE_AUTO = 0, /* found: apart where that explains most of what is unexplained otherwise */
    HADA_EXPOSURE_SAME = 1, /* all alike */
    HADA_EXPOSURE_EACH = 2  /* each by itself */
} hada_exposure;

/* A response that was compared: the share of held-out frames, geometric mean over pairs, that is unexplained with it,
 * frames being exposed alike, and apart. */
typedef struct hada_survey_row {
    double response, unexplained, unexplained_apart;
    int chosen;
} hada_survey_row;

/* Made by hada_survey_create(), which owns all of it. */
typedef struct hada_survey {
    double response;                    /* of the scenes, never HADA_AUTO */
    int exposed;                        /* 1: the frames of a depth were exposed differently */
    const double *const *gains;         /* gains[depth][pair]: the exposure of a frame over the geometric mean of its
                                           depth; NULL: all are alike */
    const hada_survey_row *const *rows; /* what was compared, ended by NULL; later versions may add members to a row */
} hada_survey;

/* Looks at up to 18 pairs of three depths; where exposures differ, at all pairs once more. `options`: sizes, channels,
 * dark level, and scene_response: HADA_AUTO to have it chosen. Pairs that do not fit are passed over, for the fit
 * itself refuses them. With fewer than two pairs of every depth nothing can be compared: then scenes are linear
 * unless `options` says otherwise, and exposures alike. */
HADA_API hada_status hada_survey_create(hada_survey **out, const hada_fit_options *options, const hada_dataset *pairs,
                                        hada_exposure exposure, hada_error *err);
HADA_API void hada_survey_destroy(hada_survey **survey);

/* The data set that was surveyed, with each scene as bright as its frame was exposed: the pairs of a camera with one
 * exposure. It shares the cache of `pairs` and may outlive both. */
HADA_API hada_status hada_survey_apply(hada_dataset **out, const hada_survey *survey, const hada_dataset *pairs,
                                       hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
