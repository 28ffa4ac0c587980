/* A data set in memory: names alone. Internal. */
#ifndef HADA_DATASET_DATASET_H
#define HADA_DATASET_DATASET_H

#include <hadalens/dataset.h>
#include <hadalens/folder.h>

#include "core/error.h"

typedef struct hada_dataset_pair {
    char *raw, *scene; /* paths */
    int number;        /* for `read` */
} hada_dataset_pair;

typedef struct hada_dataset_depth {
    double distance_mm;
    char *folder;
    int count;
    hada_dataset_pair *pair;
} hada_dataset_depth;

struct hada_dataset {
    hada_dataset_info info; /* points into what follows */
    hada_dataset_depth *depth;
    double *distances_mm;
    int *counts;
    char incomplete_text[600];
    char *psf, *camera;
    hada_dataset_read_pair read; /* NULL: files */
    void *user;
    hada_inputs *inputs; /* all files, kept from being overwritten as long as the set that was scanned lives */
};

/* Fills `info` from the depths, which stand near to far. */
hada_status hada_dataset_count(hada_dataset *dataset, hada_error *err);

/* 1: its pairs are files; 0: they come from the caller of hada_dataset_create(). */
int hada_dataset_has_files(const hada_dataset *dataset);

#endif
