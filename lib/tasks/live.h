/* Where frames of a live run come from: a pipe, or a folder that is being filled. Internal. */
#ifndef HADA_TASKS_LIVE_H
#define HADA_TASKS_LIVE_H

#include <pthread.h>
#include <sys/stat.h>
#include <time.h>

#include "io/decode.h"

/* A thread reads all that comes, so that a camera never waits, and keeps the newest whole frame. */
typedef struct hada_live_pipe {
    int fd, is_file; /* an ordinary file has time: none of its frames is left out */
    hada_headerless frames;
    size_t bytes; /* of a frame */
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t changed;
    int started, stop, ended, code; /* code: errno of a read that failed */
    unsigned char *reading, *ready, *taken;
    int is_ready;
    long come, passed_over; /* whole frames so far */
    size_t rest;            /* bytes of the frame that was begun when the pipe ended */
} hada_live_pipe;

hada_status hada_live_pipe_begin(hada_live_pipe *pipe, int fd, const hada_headerless *frames, hada_error *err);
/* What was taken from a pipe. */
typedef struct hada_live_taken {
    const unsigned char *data; /* of the newest frame, until the next call; NULL: none has come */
    long number, passed_over;  /* of the frame, from 1 on; frames that were left out so far */
    int ended;                 /* 1: no frame will come */
} hada_live_taken;

/* Waits for a frame for some seconds. */
hada_status hada_live_pipe_take(hada_live_pipe *pipe, double seconds, hada_live_taken *taken, hada_error *err);
void hada_live_pipe_end(hada_live_pipe *pipe);

/* A file of the folder, as it was when it was last looked at. */
typedef struct hada_live_file {
    char *name;
    off_t bytes;
    struct timespec changed;
    double still_since; /* hada_seconds() at which it was first seen like this */
    int done;
} hada_live_file;

typedef struct hada_live_folder {
    const char *path;
    int newest_only; /* 1: files older than the one that is taken are left out */
    hada_live_file *files;
    int count;
    long passed_over;
    double next_look;
} hada_live_folder;

/* Waits for a file for some seconds. *name: the newest file that is whole and was not done as it is now; the folder's,
 * until the next call. NULL: there is none. */
hada_status hada_live_folder_take(hada_live_folder *folder, double seconds, const char **name, hada_error *err);
void hada_live_folder_end(hada_live_folder *folder);

#endif
