/* The command line's own small world: what every command shares. Uses the public headers only. */
#ifndef HADA_CLI_H
#define HADA_CLI_H

#include <hadalens/communicator.h>
#include <hadalens/device.h>
#include <hadalens/monitor.h>
#include <hadalens/status.h>
#include <jansson.h>
#include <stdarg.h>
#include <stdio.h>

#if defined(__GNUC__)
#define HADA_CLI_PRINTF(f, a) __attribute__((format(printf, f, a)))
#else
#define HADA_CLI_PRINTF(f, a)
#endif

/* Passes an error on, as in the library: returns at once; in a function that holds something, goes to its one exit,
 * `done:`, which frees that and returns `status`. */
#define HADA_TRY(call)                                                                                                 \
    do {                                                                                                               \
        const hada_status try_status = (call);                                                                         \
        if (try_status)                                                                                                \
            return try_status;                                                                                         \
    } while (0)
#define HADA_TRY_OR_DONE(call)                                                                                         \
    do {                                                                                                               \
        status = (call);                                                                                               \
        if (status)                                                                                                    \
            goto done;                                                                                                 \
    } while (0)

/* Exit codes; docs/reference/command-line.md and every help text list them. */
enum {
    HADA_EXIT_OK = 0,
    HADA_EXIT_SOME = 1,   /* several files failed, for different reasons */
    HADA_EXIT_USAGE = 2,  /* the command line itself */
    HADA_EXIT_FILE = 3,   /* a file or folder is missing, damaged or cannot be written */
    HADA_EXIT_DATA = 4,   /* files can be read, but what they hold does not fit */
    HADA_EXIT_DEVICE = 5, /* OpenCL: none, not the one asked for, or it fails */
    HADA_EXIT_MEMORY = 6,
    HADA_EXIT_NUMERIC = 7,
    HADA_EXIT_STRANGE = 8, /* reconstruct --strict: all was written, but the camera does not belong to a frame */
    HADA_EXIT_INTERRUPTED = 130
};

/* Options that all commands have. The settings of every command begin with this. */
typedef struct hada_cli_common {
    int help, json, quiet, verbose;
    const char *device, *binaries, *shape, *limits, *headerless;
} hada_cli_common;

/* A progress bar on stderr, on a terminal only. */
typedef struct hada_cli_progress {
    int shown, drawn;
    const char *what;
    long done, total;
    double started, last;
} hada_cli_progress;

/* Ranks that run the same command together (bindings/mpi). */
typedef struct hada_cli_ranks {
    hada_communicator communicator;
    int local, locals; /* this one, of so many on this machine */
    int *agreed;       /* becomes 1 when all have come to an end together */
} hada_cli_ranks;

/* A run of one command. */
typedef struct hada_cli {
    const char *command;
    const hada_cli_common *common;
    json_t *document;            /* what --json prints at the end; filled also without --json, it is small */
    hada_cli_progress *progress; /* the bar on the screen, NULL: none */
    hada_cli_progress bar;       /* of the library's tasks */
    hada_monitor monitor;        /* for the library's tasks: bar, messages, signals */
    const hada_cli_ranks *ranks; /* that share the command; NULL: none do */
} hada_cli;

/* Whether this program writes what the ranks have made together. */
int hada_cli_writes(const hada_cli *cli);
/* For options of the library's tasks; NULL where no ranks share the command. */
const hada_communicator *hada_cli_communicator(const hada_cli *cli);
/* Before an error is printed that ends the command: what fails on all ranks alike is said by the first alone, which
 * ends the job; the others wait a moment for that. */
void hada_cli_let_first_speak(const hada_cli *cli);
/* Of all ranks, which call it together. */
long hada_cli_sum(const hada_cli *cli, long count);
/* One exit code of all ranks, on all of them: they have all come to their end. */
int hada_cli_agree(hada_cli *cli, int code);
/* Adds the entries of the other ranks to an array of the document, on the first. */
void hada_cli_gather(hada_cli *cli, const char *key);

/* The program: chooses the command, parses its options, prints the JSON document. The exit code. ranks: NULL: none. */
int hada_cli_program(int argc, char **argv, const hada_cli_ranks *ranks);

int hada_cli_exit_code(hada_status status);
hada_monitor hada_cli_monitor(hada_cli *cli);

/* Memory, all 0, and formatted text on the heap. Where there is no more the program says so and ends. */
void *hada_cli_memory(size_t count, size_t size);
void *hada_cli_longer(void *memory, size_t size); /* as realloc() */
char *hada_cli_text(const char *format, ...) HADA_CLI_PRINTF(1, 2);

/* Adds to what `text` of so many bytes holds. */
void hada_cli_append(char *text, size_t size, const char *format, ...) HADA_CLI_PRINTF(3, 4);

/* A number in a format for one; "-" where it is NaN. */
typedef char hada_cli_digits[32];
const char *hada_cli_number(hada_cli_digits text, const char *format, double value);

/* Fills *err and returns `status`. */
hada_status hada_cli_error(hada_error *err, hada_status status, const char *format, ...) HADA_CLI_PRINTF(3, 4);
/* Puts text before a message. */
void hada_cli_prefix(hada_error *err, const char *format, ...) HADA_CLI_PRINTF(2, 3);

/* Names options of the library (options.NAME) as this program spells them, in place: never longer than before. */
void hada_cli_translate(char *text);

/* Texts hold names that others chose: control characters, which a terminal would obey, become question marks, and so
 * do ends of line that are not the format's, and bytes that are no UTF-8. */
void hada_cli_put(FILE *to, const char *format, ...) HADA_CLI_PRINTF(2, 3);
void hada_cli_put_list(FILE *to, const char *format, va_list arguments) HADA_CLI_PRINTF(2, 0);
/* Results for a person, on stdout: nothing with --json or --quiet. */
void hada_cli_say(hada_cli *cli, const char *format, ...) HADA_CLI_PRINTF(2, 3);
/* Only with --verbose, on stderr. */
void hada_cli_detail(hada_cli *cli, const char *format, ...) HADA_CLI_PRINTF(2, 3);
/* On stderr, and in the JSON document's "warnings". */
void hada_cli_warn(hada_cli *cli, const char *format, ...) HADA_CLI_PRINTF(2, 3);
/* Whether this build draws pictures; where not, says that they are left out. */
int hada_cli_pictures(hada_cli *cli);
/* Prints an error on stderr. The library names options as "options.hold_out", which becomes "--hold-out" in *err. */
void hada_cli_print_error(hada_cli *cli, hada_error *err);
/* Ends a command: prints the error, puts it into the document, returns the exit code. */
int hada_cli_fail(hada_cli *cli, hada_error *err);
/* Ends a command that was called wrongly; names --help. */
int hada_cli_usage(hada_cli *cli, const char *format, ...) HADA_CLI_PRINTF(2, 3);

/* JSON values. Numbers that JSON cannot hold (NaN, infinity) become null. */
json_t *hada_cli_real(double value);
json_t *hada_cli_reals(const double *values, int count);
/* Sets members of an object: HADA_CLI_SET(object, {"psnr", psnr}, {"ssim", ssim}). */
typedef struct hada_cli_member {
    const char *key;
    double value;
} hada_cli_member;
void hada_cli_set(json_t *object, const hada_cli_member *members); /* the last one has no key */
#define HADA_CLI_SET(object, ...) hada_cli_set(object, (const hada_cli_member[]){__VA_ARGS__, {NULL, 0.0}})
json_t *hada_cli_error_json(const hada_error *err);
/* A text that may be of others: what is no UTF-8 (names of files may be anything) becomes U+FFFD. */
json_t *hada_cli_json_text(const char *text);

/* Opens the device that --device, --binaries and the environment choose. */
hada_status hada_cli_open(hada_cli *cli, hada_context **out, hada_error *err);
/* Closes it; the document tells how many programs were compiled and loaded (offline runs compile none). */
void hada_cli_close(hada_cli *cli, hada_context **context);
/* Where ranks share a machine and no device is named, each takes one of its accelerators in turn, or its part of the
 * CPU; of a list that is named, each takes an entry in turn. */
void hada_cli_take_device(const hada_cli_ranks *ranks, hada_cli_common *common, char *words, size_t size);
/* Several devices: --device takes a list such as "0,1", and "cpu/2" for the CPU in two halves. */
enum { HADA_CLI_DEVICES = 64 };
typedef struct hada_cli_contexts {
    hada_context *contexts[HADA_CLI_DEVICES];
    int count;
} hada_cli_contexts;
hada_status hada_cli_open_all(hada_cli *cli, hada_cli_contexts *devices, hada_error *err);
hada_context_info hada_cli_context_info(const hada_context *context);
void hada_cli_close_all(hada_cli *cli, hada_cli_contexts *devices);
/* A device for the document. */
json_t *hada_cli_device_json(const hada_device_info *device);
/* "1.5 GiB"; `text` holds at least 16 characters. */
const char *hada_cli_bytes(char *text, uint64_t bytes);

/* Ctrl-C, SIGTERM, SIGHUP, the end of a limited time and a pipe that nobody reads any more end the work at the next
 * occasion, so that nothing is left half-written; a second signal ends at once, and only removes what was being
 * written. */
void hada_cli_catch_signals(void);
/* Closed streams stay closed: else the next files would take their places, and have what is printed in them. */
void hada_cli_hold_streams(void);
/* Where it was a pipe, ends the program by that signal, in silence, as others do. */
void hada_cli_end_by_pipe(void);
int hada_cli_interrupted(void);
/* HADA_ERROR_CANCELLED when a signal came. */
hada_status hada_cli_check_signals(hada_error *err);

void hada_cli_progress_begin(hada_cli *cli, hada_cli_progress *progress, const char *what, long total);
void hada_cli_progress_step(hada_cli *cli, const char *note);
void hada_cli_progress_end(hada_cli *cli);
/* As hada_monitor asks for it; `user` is the run. */
void hada_cli_progress_take(void *user, const char *what, long done, long total, const char *note);
/* Takes the bar off the screen before another line is printed. */
void hada_cli_progress_hide(hada_cli *cli);

double hada_cli_seconds(void);

#endif
