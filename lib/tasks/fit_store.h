/* Pairs of a data set, as the passes of a fit ask for them: read once, as far as there is room. Internal. */
#ifndef HADA_TASKS_FIT_STORE_H
#define HADA_TASKS_FIT_STORE_H

#include <hadalens/dataset.h>
#include <hadalens/survey.h>

typedef struct hada_fit_pair_images {
    hada_image raw, scene;
} hada_fit_pair_images;

typedef struct hada_fit_store {
    hada_fit_pair_images *pairs; /* of one depth after the other; without pixels: not here */
    int count;
    size_t room; /* bytes */
} hada_fit_store;

hada_status hada_fit_store_create(hada_fit_store *store, const hada_dataset *data, hada_error *err);
void hada_fit_store_free(hada_fit_store *store);

/* A pair in hand. */
typedef struct hada_fit_loan {
    const hada_image *raw, *scene;
    hada_fit_pair_images own; /* what is not in the store */
} hada_fit_loan;

/* Pair i of depth z; where `survey` knows its exposure, with a scene as bright. store, survey: NULL: none. */
hada_status hada_fit_loan_take(hada_fit_loan *loan, hada_fit_store *store, const hada_dataset *data,
                               const hada_survey *survey, int z, int i, hada_error *err);
void hada_fit_loan_return(hada_fit_loan *loan);

#endif
