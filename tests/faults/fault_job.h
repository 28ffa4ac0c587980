/* The main job in stages, on a camera so small that a stage takes milliseconds. */
#ifndef HADA_TESTS_FAULT_JOB_H
#define HADA_TESTS_FAULT_JOB_H

#include "fault.h"

enum { JOB_ROWS = 36, JOB_COLS = 44, JOB_WINDOW = 14, JOB_DEPTHS = 2, JOB_PAIRS = 2 };

/* What the stages work on. `sum` is a checksum of all that the last stage computed. */
typedef struct fault_job {
    char folder[128], cache[160];
    char offline[160], set[160];  /* of binaries, of pairs; made when a stage first needs them */
    hada_context *context, *part; /* the other: half a device, where it can be divided */
    hada_model *model;
    hada_result result;
    hada_image scene[JOB_DEPTHS][JOB_PAIRS], frame[JOB_DEPTHS][JOB_PAIRS];
    uint64_t sum;
} fault_job;

typedef hada_status (*fault_stage)(fault_job *job, hada_error *err);

/* Opens the context and computes what the stages start from. Fails the test where that does not succeed. */
void fault_job_begin(fault_job *job);
void fault_job_end(fault_job *job);

/* Adds to the sum. */
void fault_add(fault_job *job, const void *data, size_t bytes);
void fault_add_image(fault_job *job, const hada_image *image);

/* A camera of the job's depths and sizes, learned as fits are by default. */
hada_fit_options fault_fit_options(void);
/* The camera of the job. */
hada_status fault_camera_make(hada_camera *camera, hada_error *err);

/* Each stage frees all it made, also when it fails. */
hada_status fault_stage_context(fault_job *job, hada_error *err);  /* its own context: list, choice, programs, cache */
hada_status fault_stage_whole(fault_job *job, hada_error *err);    /* the whole job in its own context, no disk cache */
hada_status fault_stage_binaries(fault_job *job, hada_error *err); /* every kernel to a folder */
hada_status fault_stage_simulate(fault_job *job, hada_error *err);
hada_status fault_stage_fit(fault_job *job, hada_error *err);
hada_status fault_stage_psf(fault_job *job, hada_error *err);
hada_status fault_stage_reconstruct(fault_job *job, hada_error *err);
hada_status fault_stage_classic(fault_job *job, hada_error *err);   /* fault_classic.c */
hada_status fault_stage_occlusion(fault_job *job, hada_error *err); /* fault_occlusion.c */
hada_status fault_stage_jobs(fault_job *job, hada_error *err); /* frames in flight on two queues and half a device */
hada_status fault_stage_net(fault_job *job, hada_error *err);  /* fault_net.c */
hada_status fault_stage_training_step(fault_job *job, hada_error *err); /* fault_replica.c */
hada_status fault_stage_trainer(fault_job *job, hada_error *err);       /* fault_trainer.c: on one device, and on two */
hada_status fault_stage_devices(fault_job *job, hada_error *err);
hada_status fault_stage_register(fault_job *job, hada_error *err); /* fault_compare.c */
hada_status fault_stage_lpips(fault_job *job, hada_error *err);
hada_status fault_stage_model_file(fault_job *job, hada_error *err);
hada_status fault_stage_tiff(fault_job *job, hada_error *err);
hada_status fault_stage_files(fault_job *job,
                              hada_error *err); /* fault_files.c: a folder, a camera, tuning, a data set */
hada_status fault_stage_judging(fault_job *job, hada_error *err); /* fault_judging.c */
hada_status fault_stage_surface(fault_job *job, hada_error *err); /* fault_surface.c */
hada_status fault_stage_optics(fault_job *job, hada_error *err);  /* fault_optics.c */
hada_status fault_stage_tuning(fault_job *job, hada_error *err);  /* fault_tuning.c */
hada_status fault_stage_offline(fault_job *job, hada_error *err); /* by binaries that were made before */
hada_status fault_stage_tasks(fault_job *job, hada_error *err);   /* fault_tasks.c */
hada_status fault_stage_training(fault_job *job, hada_error *err);
hada_status fault_stage_preview(fault_job *job, hada_error *err);
hada_status fault_stage_clfft(fault_job *job, hada_error *err); /* transforms by the other back end */

#endif
