/* A data set on disk: a folder per depth named z<distance>mm, each with raw/NAME.tif and scene/NAME.tif of the same
 * names; psf.tif (a page per depth) and camera.json beside them where known. */
#ifndef HADA_CLI_DATASET_H
#define HADA_CLI_DATASET_H

#include "cli.h"

typedef struct hada_cli_pair {
    char *raw, *scene; /* paths */
} hada_cli_pair;

typedef struct hada_cli_depth {
    double distance_mm;
    char *folder;
    int pairs;
    hada_cli_pair *pair;
} hada_cli_depth;

typedef struct hada_cli_dataset {
    int depths;
    hada_cli_depth *depth; /* near to far */
    double *distances_mm;
    int pairs;                 /* of all depths */
    int least_pairs;           /* of the depth with the fewest */
    int incomplete;            /* files without their partner */
    char incomplete_text[600]; /* the first of them, in words */
    char *psf, *camera;        /* paths, NULL where missing */
} hada_cli_dataset;

/* Reads the folders, no pictures. A depth without any pair is an error; files without their partner are an error
 * unless `skip_incomplete`. */
hada_status hada_cli_dataset_scan(hada_cli_dataset *set, const char *folder, int skip_incomplete, hada_error *err);
void hada_cli_dataset_free(hada_cli_dataset *set);

#endif
