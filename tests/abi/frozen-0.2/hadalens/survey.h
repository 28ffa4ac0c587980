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

typedef struct hada_survey hada_survey;

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

/* Looks at up to 18 pairs of three depths; where exposures differ, at all pairs once more. `options`: sizes, channels,
 * dark level, and scene_response: HADA_AUTO to have it chosen. `pairs`: how many each depth has. `show` gives them;
 * pairs that do not fit are passed over, for the fit itself refuses them. With fewer than three pairs of every depth
 * nothing can be compared: then scenes are linear unless `options` says otherwise, and exposures alike. */
HADA_API hada_status hada_survey_create(hada_survey **out, const hada_fit_options *options, const int *pairs,
                                        hada_exposure exposure, hada_fit_show show, void *user, hada_error *err);
HADA_API void hada_survey_destroy(hada_survey **survey);

/* The response of the scenes, never HADA_AUTO. */
HADA_API double hada_survey_response(const hada_survey *survey);
/* What was compared, from 0 on, NULL behind the last one; owned by the survey, which may be NULL. Later versions may
 * add members to a row, at its end. */
HADA_API const hada_survey_row *hada_survey_get_row(const hada_survey *survey, size_t index);

/* 1: the frames of a depth were exposed differently. */
HADA_API int hada_survey_exposed(const hada_survey *survey);
/* The exposure of a pair's frame, in units of the geometric mean of its depth; 1 where all are alike. */
HADA_API double hada_survey_gain(const hada_survey *survey, int depth, int pair);
/* A scene of a pair, as encoded, made as bright as its frame was exposed: then the pair is one of an even camera. */
HADA_API void hada_survey_even(const hada_survey *survey, int depth, int pair, hada_image *scene);

#ifdef __cplusplus
}
#endif
#endif
