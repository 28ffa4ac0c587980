/* Hadalens: training as the command 'train' does it: from a data set, with pairs held out, validations, checkpoints, a
 * log, and the rule which parameters are kept.
 *
 * The log folder holds losses.csv (a line a step), validation.csv, training.svg, pictures/step*.png of held-out pairs
 * (raw frame, plane before the net, output, truth; the two kinds of pictures where the build draws any) and
 * checkpoint.safetensors, with which a training that was stopped goes on with the same bits.
 *
 * Threads: a run uses the calling thread; pairs are read from others. */
#ifndef HADALENS_TASK_TRAIN_H
#define HADALENS_TASK_TRAIN_H

#include <hadalens/dataset.h>
#include <hadalens/monitor.h>
#include <hadalens/train.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum hada_keep {
    HADA_KEEP_AUTO = 0, /* the best, but the last with an adversarial loss, which gives up PSNR for looks */
    HADA_KEEP_BEST = 1, /* by the PSNR of held-out pairs */
    HADA_KEEP_LAST = 2
} hada_keep;

typedef struct hada_train_state hada_train_state;

typedef struct hada_train_task {
    size_t size;                       /* sizeof(hada_train_task) */
    const hada_train_options *options; /* how to train; NULL: hada_train_options_init() for ENHANCE */
    uint64_t epochs;                   /* not 0: how often every pair is seen, in place of options->steps */
    const hada_model *model;           /* what training begins with. NULL: a blank model for random filters and for
                                          CONVENTIONAL, else the exact fit of the pairs to learn from, made first */
    const hada_fit_options *fit;       /* without a model: form, window and dark level, as for hada_fit_run(); NULL:
                                          hada_fit_options_init() */
    int boundary;                      /* without a model: as in hada_fit_task */
    double hold_out; /* pairs of each depth to validate with: a number, or a share (hada_dataset_split()); HADA_AUTO
                        (default): an eighth */

    const char *output; /* the file to write, of the model (CONVENTIONAL: of the net): at each new best, or at each
                           checkpoint, and in the end. Needed */
    const char *log;    /* folder; NULL: OUTPUT.log */
    int resume;         /* 1: goes on from the checkpoint in the log folder, where there is one */
    int restart;        /* 1: begins anew where there is one; with neither, that is HADA_ERROR_ARGUMENT */

    /* steps between validations, pictures, checkpoints; HADA_AUTO (default): a twentieth, a quarter, a twentieth of
     * all. 0: none of the first two */
    int validate_every, show_every, save_every;
    int validate_pairs; /* at most, evenly chosen (default: 24); 0: all */
    int patience;       /* ends after so many validations without a better one; 0 (default): never */
    hada_keep keep;

    /* Called with what there is to tell; NULL: nobody asks. */
    void (*tell)(void *user, const hada_train_state *state);
    void *user;
    const hada_monitor *monitor;
} hada_train_task;
HADA_INIT(hada_train_task, HADA_STRUCT_TRAIN_TASK)

typedef enum hada_train_event {
    HADA_TRAIN_BEGINS = 1,    /* the trainer is made; nothing was trained yet */
    HADA_TRAIN_TIMED = 2,     /* a few steps tell how long the others will take */
    HADA_TRAIN_VALIDATED = 3, /* held-out pairs were looked at: the last of `rows` */
    HADA_TRAIN_ENDS = 4       /* well, early, stopped or with an error */
} hada_train_event;

typedef struct hada_train_row {
    uint64_t step;
    const hada_validation *result;
} hada_train_row;

/* How far a training is. The library's; valid during the call. */
struct hada_train_state {
    hada_train_event event;
    hada_status status;                /* at the end: how */
    const hada_train_options *options; /* as the trainer understood them */
    const hada_net *net;               /* that is trained, with its first values; NULL: none */
    int depths, learned, held_out;     /* depths; pairs to learn from, and held out */
    uint64_t first, step, steps;       /* where this run began; done; of all */
    double seconds, seconds_per_step;
    double loss;     /* of the last good step of this run; 0 before */
    int rolled_back; /* steps that were */
    int better;      /* VALIDATED: 1 where it is the best so far */
    int keep_best;   /* 1: the output holds the best, 0: the last */
    double best_psnr;
    uint64_t best_step;
    const hada_train_row *rows; /* all validations, those before a resumed run as well */
    size_t row_count;
    const char *log, *output;
};

/* Trains on one or more devices, a context each. HADA_ERROR_CANCELLED where the monitor wanted to stop: the checkpoint
 * is written then. */
HADA_API hada_status hada_train_run(hada_context *const *contexts, int count, const hada_dataset *data,
                                    const hada_train_task *task, hada_error *err);

#ifdef __cplusplus
}
#endif
#endif
