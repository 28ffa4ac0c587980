#include "cli.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

/* Messages of the library come from the threads of its queues. */
static pthread_mutex_t screen = PTHREAD_MUTEX_INITIALIZER;

double hada_cli_seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void hada_cli_progress_begin(hada_cli *cli, hada_cli_progress *progress, const char *what, long total)
{
    memset(progress, 0, sizeof *progress);
    progress->shown = isatty(STDERR_FILENO) && !cli->common->quiet;
    progress->what = what;
    progress->total = total;
    progress->started = progress->last = hada_cli_seconds();
    cli->progress = progress;
}

static void draw(hada_cli_progress *progress, const char *note)
{
    enum { WIDTH = 24 };
    char bar[WIDTH + 1];
    double share = progress->total > 0 ? (double)progress->done / (double)progress->total : 0;
    double passed = hada_cli_seconds() - progress->started;
    for (int i = 0; i < WIDTH; i++)
        bar[i] = i < share * WIDTH ? '#' : '.';
    bar[WIDTH] = '\0';
    if (progress->total > 0)
        fprintf(stderr, "\r\033[K%s [%s] %ld of %ld", progress->what, bar, progress->done, progress->total);
    else /* not known beforehand */
        fprintf(stderr, "\r\033[K%ld %s", progress->done, progress->what);
    if (passed > 1 && progress->done > 1 && !strcmp(progress->what, "frames"))
        fprintf(stderr, ", %.3g a second", (double)progress->done / passed);
    if (share > 0 && share < 1 && passed > 1)
        fprintf(stderr, ", %.0f s left", passed * (1 - share) / share);
    if (note)
        hada_cli_put(stderr, "  %.40s", note);
    fflush(stderr);
    progress->drawn = 1;
}

void hada_cli_progress_step(hada_cli *cli, const char *note)
{
    pthread_mutex_lock(&screen);
    hada_cli_progress *progress = cli->progress;
    double now = hada_cli_seconds();
    if (progress)
        progress->done++;
    /* Ten times a second is enough for any eye. */
    if (progress && progress->shown && (now - progress->last > 0.1 || progress->done == 1)) {
        progress->last = now;
        draw(progress, note);
    }
    pthread_mutex_unlock(&screen);
}

static void hide(hada_cli_progress *progress)
{
    if (progress && progress->drawn) {
        fputs("\r\033[K", stderr);
        progress->drawn = 0;
    }
}

void hada_cli_progress_hide(hada_cli *cli)
{
    pthread_mutex_lock(&screen);
    hide(cli->progress);
    pthread_mutex_unlock(&screen);
}

void hada_cli_progress_end(hada_cli *cli)
{
    pthread_mutex_lock(&screen);
    hide(cli->progress);
    cli->progress = NULL;
    pthread_mutex_unlock(&screen);
}

void hada_cli_progress_take(void *user, const char *what, long done, long total, const char *note)
{
    hada_cli *cli = user;
    if (!what)
        hada_cli_progress_end(cli);
    else if (!done)
        hada_cli_progress_begin(cli, &cli->bar, what, total);
    cli->bar.total = total; /* may become known on the way */
    if (done)
        hada_cli_progress_step(cli, note);
}
