/* What the parts of 'hadalens bench' share: measured rows, workloads, settings. */
#ifndef HADA_CLI_BENCH_H
#define HADA_CLI_BENCH_H

#include <hadalens/model.h>
#include <hadalens/plot.h>
#include <hadalens/profile.h>
#include <hadalens/reconstruct.h>

#include "bench_stats.h"
#include "cli.h"

typedef enum hada_bench_group {
    HADA_BENCH_PEAK,       /* ceilings of the device */
    HADA_BENCH_START,      /* from nothing to the first frame */
    HADA_BENCH_LATENCY,    /* one frame at a time */
    HADA_BENCH_STAGE,      /* its stages, per depth */
    HADA_BENCH_KERNEL,     /* kernels and transfers of a frame */
    HADA_BENCH_CALLS,      /* what a frame asks of the device, and the time that it should take */
    HADA_BENCH_MEMORY,     /* bytes stated and held */
    HADA_BENCH_THROUGHPUT, /* many frames */
    HADA_BENCH_SEQUENCE,   /* films */
    HADA_BENCH_SWEEP       /* run time against error */
} hada_bench_group;
extern const char *const hada_bench_group_names[]; /* ended by NULL */

typedef enum hada_bench_method {
    HADA_BENCH_OWN, /* the model's own filters */
    HADA_BENCH_MATCHED,
    HADA_BENCH_WIENER,
    HADA_BENCH_REFINED /* planes by refinement: no filters */
} hada_bench_method;

/* What is varied in the sweep. */
typedef struct hada_bench_setting {
    hada_bench_method method;
    int half, refine;
    unsigned skip;
    double max_error;
    const char *skip_name;
    int clfft; /* transforms by clFFT */
} hada_bench_setting;

typedef struct hada_bench_row {
    char device[256];  /* its name; "" where none matters */
    char workload[64]; /* "" where none matters */
    hada_bench_group group;
    char name[128];   /* unique within device, workload and group */
    const char *unit; /* a constant */
    int better;       /* 1: more is better; -1: less is */
    hada_bench_figure value;
    /* of the sweep; NaN where not known */
    double error;               /* relative L2 of the stack against the dense run of the same method and steps */
    double bound;               /* what the run said of it */
    double psnr, psnr_in_focus; /* against the truth, dB; of films as well */
    int front;
    hada_bench_setting setting;
    double bytes, flops; /* of a kernel, per frame */
} hada_bench_row;

typedef struct hada_bench {
    hada_cli *cli;
    int quick, rounds;
    char *scratch;   /* a folder that is removed at the end */
    double patience; /* seconds for one measurement, once it has three values */
    hada_bench_row *rows;
    int count, room;
} hada_bench;

/* Adds a row of that name, with NaN and 0 in what does not apply, which may be set in what it returns. */
hada_bench_row *hada_bench_add(hada_bench *bench, const char *device, const char *workload, hada_bench_group group,
                               const char *unit, int better, hada_bench_figure value, const char *name, ...)
    HADA_CLI_PRINTF(8, 9);
const hada_bench_row *hada_bench_find(const hada_bench *bench, const char *device, const char *workload,
                                      hada_bench_group group, const char *name);
/* All rows of a group, those of the longest time first, to be freed. */
const hada_bench_row **hada_bench_rows_of(const hada_bench *bench, const char *device, const char *workload,
                                          hada_bench_group group, int *count);

/* A model, frames of its camera, and what stood before it. */
typedef struct hada_bench_workload {
    char name[64];
    hada_model *model;
    int frames;
    hada_image *raw;
    int depths;
    hada_image *truth; /* [frame][depth]: the window's scene; no pixels where dark; NULL: not known */
} hada_bench_workload;

/* "sim300", "sim512": fitted from simulated pairs; "paper2022": from its point spread functions. */
hada_status hada_bench_workload_make(hada_bench *bench, hada_bench_workload *workload, hada_context *context,
                                     const char *name, hada_error *err);
/* A user's model and files; without files a frame is drawn from the model (no truth). */
hada_status hada_bench_workload_load(hada_bench_workload *workload, const char *model, const char *const *files,
                                     int count, hada_error *err);
/* Planes go through a new net of this preset behind it, run at rows x cols (0, 0: the window's size): its weights are
 * random, which takes the time of trained ones. The workload's name takes the preset's behind a `+`. */
hada_status hada_bench_workload_enhance(hada_bench_workload *workload, const char *preset, int rows, int cols,
                                        hada_error *err);
void hada_bench_workload_free(hada_bench_workload *workload);
int hada_bench_workload_known(const char *name);
extern const char hada_bench_workload_names[];

/* What a device does at best, and what calls to it cost. */
enum { HADA_BENCH_COPY, HADA_BENCH_ARITHMETIC, HADA_BENCH_LAUNCH, HADA_BENCH_WAIT, HADA_BENCH_WRITE, HADA_BENCH_PEAKS };

/* A device in use. */
typedef struct hada_bench_device {
    hada_device_info info;
    hada_context *context;
    hada_cli cli; /* of this device: the name it is opened by */
    hada_cli_common common;
    char index[16];
    double peak[HADA_BENCH_PEAKS]; /* medians: bytes and operations a second, seconds a call */
} hada_bench_device;

/* A clock for repeated runs: fills values until it has `rounds`, or three and the patience is over. */
typedef hada_status (*hada_bench_work)(void *user, int round, double *value, hada_error *err);
hada_status hada_bench_repeat(const hada_bench *bench, hada_bench_work work, void *user, int rounds, double *values,
                              int *count, hada_error *err);

/* Whether a measurement failed because the device has too little memory, or lacks something, for it: that is told, and
 * the others go on. */
int hada_bench_left_out(const hada_bench *bench, hada_status status, const char *what, const hada_error *err);

/* The measurements; each adds its rows. */
hada_status hada_bench_peaks(hada_bench *bench, hada_bench_device *device, hada_error *err);
hada_status hada_bench_latency(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                               hada_error *err);
hada_status hada_bench_sweep(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                             hada_error *err);
hada_status hada_bench_throughput(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                                  hada_error *err);
/* Of a workload that was made. */
hada_status hada_bench_sequence(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                                hada_error *err);
hada_status hada_bench_start(hada_bench *bench, hada_bench_device *device, const hada_bench_workload *workload,
                             hada_error *err);
/* What the processes of hada_bench_start() do: opens the device, makes a plan, runs a frame twice, closes; the document
 * of `cli` tells the seconds. linear: with the linear filters alone, which need fewer kernels. */
hada_status hada_bench_first_frame(hada_cli *cli, const char *model, const char *frame, int linear, hada_error *err);

/* Two ways to run a frame, whose latency is measured. */
enum { HADA_BENCH_MODES = 2 };
extern const char *const hada_bench_mode_names[HADA_BENCH_MODES];
void hada_bench_mode_options(int mode, hada_plan_options *options);

/* Stages of hada_report, in order. */
enum { HADA_BENCH_STAGES = 7 };
extern const char *const hada_bench_stage_names[HADA_BENCH_STAGES];
double hada_bench_stage_seconds(const hada_report *report, int stage);

/* A device and a workload that was measured on it. */
enum { HADA_BENCH_PLACES = 64 };
typedef struct hada_bench_place {
    const char *device, *workload;
    char suffix[16]; /* of file names, where there are several devices */
    int number;      /* of the device */
    int first_of_workload;
} hada_bench_place;
int hada_bench_places(const hada_bench *bench, hada_bench_place *places);

/* What came out. */
hada_status hada_bench_json(const hada_bench *bench, json_t *document, hada_error *err);
hada_status hada_bench_write(const hada_bench *bench, const char *folder, hada_error *err);
hada_status hada_bench_plots(const hada_bench *bench, const char *folder, hada_error *err);
void hada_bench_print(const hada_bench *bench);
hada_status hada_bench_compare(hada_cli *cli, const char *old_path, const char *new_path, hada_error *err);

#endif
