#include "cli.h"

#include <hadalens/folder.h>
#include <hadalens/preview.h>

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t interrupted;

int hada_cli_exit_code(hada_status status)
{
    switch (status) {
    case HADA_OK: return HADA_EXIT_OK;
    case HADA_ERROR_ARGUMENT:
    case HADA_ERROR_STATE:
    case HADA_ERROR_UNSUPPORTED: return HADA_EXIT_USAGE;
    case HADA_ERROR_CANCELLED: return HADA_EXIT_INTERRUPTED;
    case HADA_ERROR_MEMORY:
    case HADA_ERROR_DEVICE_MEMORY: return HADA_EXIT_MEMORY;
    case HADA_ERROR_FILE_OPEN:
    case HADA_ERROR_FILE_READ:
    case HADA_ERROR_FILE_FORMAT:
    case HADA_ERROR_FILE_WRITE: return HADA_EXIT_FILE;
    case HADA_ERROR_SIZE:
    case HADA_ERROR_NOT_FINITE:
    case HADA_ERROR_DATASET:
    case HADA_ERROR_MODEL: return HADA_EXIT_DATA;
    case HADA_ERROR_NO_DEVICE:
    case HADA_ERROR_DEVICE_CHOICE:
    case HADA_ERROR_DEVICE:
    case HADA_ERROR_BUILD:
    case HADA_ERROR_SELF_TEST: return HADA_EXIT_DEVICE;
    case HADA_ERROR_NUMERIC: return HADA_EXIT_NUMERIC;
    }
    return HADA_EXIT_SOME;
}

static void *needed(void *memory)
{
    if (!memory) {
        fputs("hadalens: out of memory\n", stderr);
        hada_outputs_remove();
        exit(HADA_EXIT_MEMORY);
    }
    return memory;
}

void *hada_cli_memory(size_t count, size_t size)
{
    return needed(calloc(count + !count, size));
}

void *hada_cli_longer(void *memory, size_t size)
{
    return needed(realloc(memory, size));
}

char *hada_cli_text(const char *format, ...)
{
    char *text = NULL;
    va_list arguments;
    va_start(arguments, format);
    const int length = vasprintf(&text, format, arguments);
    va_end(arguments);
    return needed(length < 0 ? NULL : text);
}

void hada_cli_append(char *text, size_t size, const char *format, ...)
{
    const size_t used = strlen(text);
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text + used, size - used, format, arguments);
    va_end(arguments);
}

const char *hada_cli_number(hada_cli_digits text, const char *format, double value)
{
    if (isnan(value))
        return "-";
    snprintf(text, sizeof(hada_cli_digits), format, value);
    return text;
}

hada_status hada_cli_error(hada_error *err, hada_status status, const char *format, ...)
{
    va_list arguments;
    err->status = status;
    err->cl_code = 0;
    err->detail[0] = '\0';
    va_start(arguments, format);
    vsnprintf(err->message, sizeof err->message, format, arguments);
    va_end(arguments);
    return status;
}

void hada_cli_prefix(hada_error *err, const char *format, ...)
{
    char old[sizeof err->message], prefix[512];
    va_list arguments;
    memcpy(old, err->message, sizeof old);
    va_start(arguments, format);
    vsnprintf(prefix, sizeof prefix, format, arguments);
    va_end(arguments);
    /* A message that already names the file is not made longer. */
    if (!strncmp(old, prefix, strlen(prefix)))
        return;
    snprintf(err->message, sizeof err->message, "%s%.*s", prefix, (int)(sizeof old - sizeof prefix), old);
}

void hada_cli_say(hada_cli *cli, const char *format, ...)
{
    if (cli->common->json || cli->common->quiet)
        return;
    hada_cli_progress_hide(cli);
    va_list arguments;
    va_start(arguments, format);
    hada_cli_put_list(stdout, format, arguments);
    va_end(arguments);
    putchar('\n');
    fflush(stdout);
}

void hada_cli_detail(hada_cli *cli, const char *format, ...)
{
    if (!cli->common->verbose)
        return;
    hada_cli_progress_hide(cli);
    va_list arguments;
    va_start(arguments, format);
    hada_cli_put_list(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
}

void hada_cli_warn(hada_cli *cli, const char *format, ...)
{
    char text[1200];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    hada_cli_progress_hide(cli);
    if (!cli->common->quiet)
        hada_cli_put(stderr, "hadalens %s: note: %s\n", cli->command, text);
    json_t *list = json_object_get(cli->document, "warnings");
    if (!list) {
        list = json_array();
        json_object_set_new(cli->document, "warnings", list);
    }
    json_array_append_new(list, hada_cli_json_text(text));
}

/* How this program spells the option whose name `text` begins with; NULL: as it is. *length: of the name. */
static const char *spell(const char *text, size_t *length)
{
    static const char *const own[][2] = {{"output", "-o"},        {"model", "-m"},
                                         {"mosaic", "--bayer"},   {"repair_not_finite", "--repair"},
                                         {"classic", "--method"}, {"enhance 0", "--no-enhance"}};
    *length = strspn(text, "abcdefghijklmnopqrstuvwxyz_");
    for (size_t i = 0; i < sizeof own / sizeof *own; i++) {
        const size_t all = strlen(own[i][0]);
        if (all >= *length && !strncmp(text, own[i][0], all)) {
            *length = all;
            return own[i][1];
        }
    }
    return NULL;
}

void hada_cli_translate(char *text)
{
    static const char mark[] = "options.", header[] = "hadalens/register.h";
    char *to = text;
    for (const char *from = text; *from;) {
        const char *name = from + sizeof mark - 1, *own = NULL;
        size_t length = 0;
        if (!strncmp(from, mark, sizeof mark - 1))
            own = spell(name, &length);
        else if (!strncmp(from, header, sizeof header - 1)) {
            name = from;
            own = "--register";
            length = sizeof header - 1;
        }
        if (!length) {
            *to++ = *from++;
            continue;
        }
        to = stpcpy(to, own ? own : "--");
        for (size_t i = 0; !own && i < length; i++)
            *to++ = (char)(name[i] == '_' ? '-' : name[i]);
        from = name + length;
    }
    *to = '\0';
}

void hada_cli_print_error(hada_cli *cli, hada_error *err)
{
    hada_cli_translate(err->message);
    hada_cli_progress_hide(cli);
    if (hada_cli_writes(cli))
        hada_cli_put(stderr, "hadalens %s: %s\n", cli->command, err->message);
    else
        hada_cli_put(stderr, "hadalens %s, rank %d of %d: %s\n", cli->command, cli->ranks->communicator.rank,
                     cli->ranks->communicator.count, err->message);
    for (const char *line = err->detail; cli->common->verbose && *line; line += strcspn(line, "\n"), line += *line > 0)
        hada_cli_put(stderr, "%.*s\n", (int)strcspn(line, "\n"), line);
    if (err->detail[0] && !cli->common->verbose)
        fprintf(stderr, "(--verbose shows more)\n");
}

/* How long the other ranks wait for the first, which may be slow on a busy machine, to say why a command ends; and,
 * told by a signal that the job ends, to be ended: mpirun kills a second later. */
enum { FIRST_SPEAKS_SECONDS = 3, JOB_ENDS_SECONDS = 10 };

void hada_cli_let_first_speak(const hada_cli *cli)
{
    const int before = hada_cli_interrupted();
    if (hada_cli_writes(cli))
        return;
    nanosleep(&(struct timespec){.tv_sec = FIRST_SPEAKS_SECONDS}, NULL);
    if (!before && hada_cli_interrupted())
        nanosleep(&(struct timespec){.tv_sec = JOB_ENDS_SECONDS}, NULL);
}

int hada_cli_fail(hada_cli *cli, hada_error *err)
{
    if (err->status == HADA_ERROR_BUILD) /* a driver's compiler gives up at a signal by itself, as PoCL's does */
        hada_cli_check_signals(err);
    hada_cli_let_first_speak(cli);
    hada_cli_print_error(cli, err);
    json_object_set_new(cli->document, "error", hada_cli_error_json(err));
    return hada_cli_exit_code(err->status);
}

int hada_cli_usage(hada_cli *cli, const char *format, ...)
{
    hada_error err;
    char text[900];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    hada_cli_error(&err, HADA_ERROR_ARGUMENT, "%s", text);
    if (!hada_cli_writes(cli)) { /* the first rank says it for all */
        hada_cli_let_first_speak(cli);
        return HADA_EXIT_USAGE;
    }
    hada_cli_fail(cli, &err);
    fprintf(stderr, "Try 'hadalens %s --help'.\n", cli->command);
    return HADA_EXIT_USAGE;
}

static void take_message(void *user, hada_message kind, const char *text)
{
    hada_cli *cli = user;
    char words[1200];
    snprintf(words, sizeof words, "%s", text);
    hada_cli_translate(words);
    if (kind == HADA_MESSAGE_NOTE)
        hada_cli_warn(cli, "%s", words);
    else if (kind == HADA_MESSAGE_INFO)
        hada_cli_say(cli, "%s", words);
    else
        hada_cli_detail(cli, "%s", words);
}

static int is_cancelled(void *user)
{
    (void)user;
    return interrupted;
}

hada_monitor hada_cli_monitor(hada_cli *cli)
{
    hada_monitor monitor;
    hada_monitor_init(&monitor);
    monitor.user = cli;
    monitor.progress = hada_cli_progress_take;
    monitor.message = take_message;
    monitor.cancelled = is_cancelled;
    return monitor;
}

json_t *hada_cli_real(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

json_t *hada_cli_reals(const double *values, int count)
{
    json_t *list = json_array();
    for (int i = 0; i < count; i++)
        json_array_append_new(list, hada_cli_real(values[i]));
    return list;
}

void hada_cli_set(json_t *object, const hada_cli_member *members)
{
    for (; members->key; members++)
        json_object_set_new(object, members->key, hada_cli_real(members->value));
}

json_t *hada_cli_error_json(const hada_error *err)
{
    json_t *object = json_pack("{s:s, s:i, s:o}", "status", hada_status_name(err->status), "exit_code",
                               hada_cli_exit_code(err->status), "message", hada_cli_json_text(err->message));
    if (object && err->detail[0])
        json_object_set_new(object, "detail", hada_cli_json_text(err->detail));
    return object;
}

/* A pipe that nobody reads tells so at every write, a limit of time at every second beyond it: once is enough. */
static void on_signal(int number)
{
    if (interrupted && number != SIGPIPE && number != SIGXCPU) {
        hada_outputs_remove();
        signal(number, SIG_DFL);
        raise(number);
    }
    interrupted = number;
}

void hada_cli_catch_signals(void)
{
    /* SIGUSR2: from batch systems; SIGUSR1 is swallowed by LLVM, which CPU drivers bring */
    const int numbers[] = {SIGINT, SIGTERM, SIGPIPE, SIGHUP, SIGUSR2, SIGXCPU};
    static int hangups = -1; /* nohup and its like let SIGHUP be ignored; a driver's handler would hide that later */
    struct sigaction now = {.sa_handler = on_signal, .sa_flags = SA_RESTART}, before;
    sigemptyset(&now.sa_mask);
    if (hangups < 0)
        hangups = sigaction(SIGHUP, NULL, &before) || before.sa_handler != SIG_IGN;
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++)
        if (numbers[i] != SIGHUP || hangups)
            sigaction(numbers[i], &now, NULL);
    signal(SIGXFSZ, SIG_IGN); /* a file beyond the limit for files is a write that fails, with a message */
}

void hada_cli_hold_streams(void)
{
    for (int fd = STDIN_FILENO; fd <= STDERR_FILENO; fd++)
        if (fcntl(fd, F_GETFD) < 0 && open("/dev/null", fd == STDIN_FILENO ? O_WRONLY : O_RDONLY) < 0)
            return; /* it has the lowest number that is free, this one; and the wrong direction */
}

void hada_cli_end_by_pipe(void)
{
    if (interrupted != SIGPIPE)
        return;
    signal(SIGPIPE, SIG_DFL);
    raise(SIGPIPE);
}

int hada_cli_interrupted(void)
{
    return interrupted;
}

hada_status hada_cli_check_signals(hada_error *err)
{
    return interrupted ? hada_cli_error(err, HADA_ERROR_CANCELLED, "stopped; the file in progress was not written")
                       : HADA_OK;
}

int hada_cli_pictures(hada_cli *cli)
{
    if (!hada_pictures_available())
        hada_cli_warn(cli, "pictures are left out: there is no cairo (Debian: libcairo2, or libcairo2-dev and build "
                           "again)");
    return hada_pictures_available();
}
