/* The inside of a data set: what it shares with its parts, and its cache. Internal. */
#ifndef HADA_DATASET_DATASET_H
#define HADA_DATASET_DATASET_H

#include <hadalens/dataset.h>
#include <hadalens/folder.h>
#include <pthread.h>

#include "image/colour_matrix.h"

typedef struct hada_dataset_depth {
    double distance_mm;
    char *folder;
    int count, before; /* pairs; those of the depths before */
    hada_pair_files *files;
} hada_dataset_depth;

typedef struct hada_pair_images {
    hada_image raw, scene;
    hada_image weights; /* of the raw frame's values: 1, below 0 where they are saturated; empty: all are 1 */
} hada_pair_images;

/* The pair that the thread reads next: nothing to do, to be read, being read, or read (or failed). */
typedef enum hada_ahead_state {
    HADA_AHEAD_IDLE,
    HADA_AHEAD_WANTED,
    HADA_AHEAD_READING,
    HADA_AHEAD_READY
} hada_ahead_state;

/* Replaces a scene of a depth by one that is placed otherwise. It may be called by several threads at once. */
typedef hada_status (*hada_place_scene)(const void *placement, int depth, hada_image *scene, hada_error *err);

/* What a data set and its parts share. Pairs are numbered over all depths. */
typedef struct hada_pair_store {
    int depths, pairs, incomplete;
    hada_dataset_depth *depth;
    char **folders;
    char incomplete_text[600];
    char *psf, *camera;
    double frame_encoding;
    hada_mosaic mosaic;        /* of the raw frames that are given out */
    int downsample;            /* by which those of the sensor and scenes are binned */
    hada_mosaic sensor_mosaic; /* of those */
    hada_image flat;           /* sensitivity of the pixels of either; empty: all alike */
    double flat_dark;
    hada_image dark;     /* subtracted from either, of all channels; empty: nothing is */
    hada_inputs *inputs; /* all files, which no output may replace */
    char **alone;        /* files without a partner, which belong to them until these are protected */
    int alone_count;

    /* one of these reads pairs: files (both NULL), the caller's function, or the caller's images */
    hada_dataset_read_pair read;
    void *user;
    const hada_image *raws, *scenes, *weights; /* weights NULL: found from the raw frames */
    pthread_mutex_t reading;                   /* held while the caller's function runs */

    hada_place_scene place; /* NULL: scenes are given out as they were read */
    void *placement;        /* for it; free() */

    pthread_mutex_t lock;   /* of all that follows */
    int users;              /* the data set and its parts */
    hada_pair_images *kept; /* of each pair; empty: not kept */
    uint64_t room;          /* bytes left for pairs */

    struct {
        pthread_t thread;
        int running, stop;
        pthread_cond_t changed;
        hada_ahead_state state;
        int number; /* of the pair */
        hada_pair_images images;
        hada_status status;
        hada_error error;
    } ahead;
} hada_pair_store;

/* Scenes in place of those that were read, by hada_pair_number(). */
typedef struct hada_filled_scene {
    int number;
    hada_image scene;
} hada_filled_scene;

typedef struct hada_filled_scenes {
    int count;
    hada_filled_scene *list;
} hada_filled_scenes;

struct hada_dataset {
    hada_dataset_info info; /* points into the store and what follows */
    hada_pair_store *store;
    int *first, *counts; /* the pairs of each depth that belong to this part */
    int *number;         /* of each pair of this part within its depth; NULL: from `first` on, one after the other */
    hada_pair_files *listed; /* their files then */
    double *distances_mm;
    const hada_pair_files **files;
    const hada_filled_scenes *filled; /* NULL: all scenes are as they were read */
    /* in place of the store's: a flat frame with more pixels of 0, and a dark frame; NULL: the store's */
    const hada_image *mended, *darkened;
    const double *light; /* surfaces that are subtracted, [pair of the store][channel][HADA_SMOOTH_TERMS]; NULL: none */
    const double *balance; /* by which they are multiplied then, [pair of the store][channel]; NULL: 1 */
    int channels;          /* of light and balance */
    double *gain; /* of each pair of this part: its scene is made so many times as bright; NULL: scenes as they are */
    double response;                  /* in which scenes are encoded, where there are gains */
    double unmix[HADA_COLOUR_MATRIX]; /* by which frames are multiplied; all 0: by nothing */
    double encoding;                  /* of the store's frames, which are made linear; 0: they are */
};

/* A store that is empty but for its options. `callers` may be NULL. */
hada_status hada_pair_store_create(hada_pair_store **out, const hada_dataset_options *callers, hada_error *err);
void hada_pair_store_release(hada_pair_store **store);
/* Has the caller's function read a pair. A failure has a message, which names the pair where the function gave none. */
hada_status hada_pair_store_call(hada_pair_store *store, int depth, int number, hada_image *raw, hada_image *scene,
                                 hada_error *err);

/* Both images of a pair and weights: the cache's, which keeps them until the end, or else *own. keep: what is read goes
 * into the cache where there is room. Not of a store of the caller's images. */
hada_status hada_pair_store_find(hada_pair_store *store, int number, int keep, hada_pair_images *own,
                                 const hada_pair_images **found, hada_error *err);
void hada_pair_images_free(hada_pair_images *images);

/* Has a thread read a pair that will be taken soon. */
void hada_pair_store_expect(hada_pair_store *store, int number);

/* From now on all scenes that are read (of files, or by the caller's function) go through `place`; pairs that were read
 * before are dropped. Nobody uses the data set or its parts meanwhile. It takes `placement` over. */
void hada_pair_store_place(hada_pair_store *store, hada_place_scene place, void *placement);

/* A data set of all pairs of a store, whose depths are listed; takes the store over, also where it fails. */
hada_status hada_dataset_open(hada_dataset **out, hada_pair_store *store, hada_error *err);

/* The pairs for which leave[depth][pair] is 0; of each depth there is one. */
hada_status hada_dataset_select(hada_dataset **out, const hada_dataset *from, const unsigned char *const *leave,
                                hada_error *err);

/* The same pairs, with other scenes in place of some, which must stay as long as it and its parts. */
hada_status hada_dataset_fill(hada_dataset **out, const hada_dataset *from, const hada_filled_scenes *filled,
                              hada_error *err);

/* The same pairs. Raw frames are repaired where `flat`, which is that of `from` otherwise (1 where it has none), is 0;
 * `dark`, where `from` has no dark frame, is subtracted. Either may be NULL. They are of the frames' channels and size,
 * and must stay as long as the part and its parts. */
hada_status hada_dataset_mend(hada_dataset **out, const hada_dataset *from, const hada_image *flat,
                              const hada_image *dark, hada_error *err);

/* The number of a pair, the same in all parts of a data set. */
int hada_pair_number(const hada_dataset *dataset, int depth, int pair);

/* The same pairs, with scenes that are gains[depth][pair] times as bright in linear light, `response` being how they
 * are encoded; gains NULL: as they are. */
hada_status hada_dataset_brighten(hada_dataset **out, const hada_dataset *from, const double *const *gains,
                                  double response, hada_error *err);

/* The same pairs, with raw frames of three channels that were m, [channel][colour], times what these are now; m all 0:
 * as they are. */
hada_status hada_dataset_unmix(hada_dataset **out, const hada_dataset *from, const double m[HADA_COLOUR_MATRIX],
                               hada_error *err);

/* The same pairs, without a smooth surface of each raw frame of so many channels, light[pair][channel]
 * [HADA_SMOOTH_TERMS] by hada_pair_number(), which must stay as long as the part and its parts. */
hada_status hada_dataset_unlit(hada_dataset **out, const hada_dataset *from, const double *light, int channels,
                               hada_error *err);

/* The same pairs, with raw frames of so many channels times balance[pair][channel], of the same rules. */
hada_status hada_dataset_balance(hada_dataset **out, const hada_dataset *from, const double *balance, int channels,
                                 hada_error *err);

/* The same pairs; their raw frames have this encoding (hadalens/response.h) and are given out in linear light. */
hada_status hada_dataset_decode(hada_dataset **out, const hada_dataset *from, double encoding, hada_error *err);

/* The raw frame of a pair as it is read, in linear light: before it is filled in, divided and binned. *image is created
 * by the call. */
hada_status hada_pair_load_raw(const hada_dataset *dataset, int depth, int pair, hada_image *image, hada_error *err);

/* As hada_dataset_from_images(), with an image of weights for each frame (hada_pair); an empty one: all are 1. */
hada_status hada_dataset_from_weighted(hada_dataset **out, int depths, const double *distances_mm, const int *counts,
                                       const hada_image *raws, const hada_image *scenes, const hada_image *weights,
                                       hada_error *err);

/* A pair in use: images that the cache, the caller or the pair itself owns. weights: of the raw frame's values: 1, 0
 * where nothing is known, below 0 where they are saturated: the least that the sensor saw. NULL: all are 1. They are
 * found before a dark frame, a flat frame or mixed colours change what is saturated. */
typedef struct hada_pair {
    const hada_image *raw, *scene, *weights;
    hada_pair_images own;
} hada_pair;
hada_status hada_pair_take(hada_pair *pair, const hada_dataset *dataset, int depth, int number, hada_error *err);
void hada_pair_return(hada_pair *pair);

/* hada_pair_store_expect() by a pair's depth and number. */
void hada_pair_expect(const hada_dataset *dataset, int depth, int number);

/* Puts the names of a pair's files before a message. */
void hada_pair_name(const hada_dataset *dataset, int depth, int number, hada_error *err);

#endif
