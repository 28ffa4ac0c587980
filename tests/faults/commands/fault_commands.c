/* fault_commands FOLDER: every command of the command line, with the n-th call for memory, to OpenCL or to a file
 * failing. Each run is a process of its own: a failing one ends by itself, with a message and an exit code that says
 * so, and leaves what was there before; one that goes on without harm gives what an undisturbed run gives.
 *
 * FAULT_RUNS (3; sites; chains; all) is how many n of each kind and command are tried, evenly spread; chains: one call
 * of every chain of callers that leads to one; sites: so many that every call in such a chain has failed once.
 * FAULT_ONLY=COMMAND:KIND:N one of them (or a part of that from the left), FAULT_JOBS (1) how many processes run at
 * once; FAULT_TRACE=1 tells of each run what failed, and how it ended. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "fault.h"
#include "fault_chain.h"
#include "fault_watch.h"
#include "trees.h"

int hada_cli_main(int argc, char **argv);

/* SECONDS of processor time for a run with a fault, so many times as much for what comes before, which may have to
 * compile all kernels; LOOK: of the clock, in which a run that takes next to none does not get on. */
enum { MOST_WORDS = 32, SECONDS = 300, UNDISTURBED = 12, LOOK = 150, LAST_EXIT = 7, MOST_JOBS = 64 };

/* What a command may leave of its output when it fails: nothing (or what was there before), or some files of it, each
 * whole; what it writes when it succeeds is the same every time, or holds times that it measured. */
typedef enum leaves { NOTHING, WHOLE_FILES, MEASURED } leaves;

typedef struct fault_command {
    const char *name, *words, *output; /* of the output: its first part; NULL: only what it prints */
    leaves leaves;
} fault_command;

#define SMALL "--preset sim300 --size 40x48 --window 24x24 --depths 3 --lenses 3 --pairs 3 --channels 1"

static const fault_command commands[] = {
    {"devices", "devices --save-binaries kernels", "kernels", MEASURED}, /* a driver's binaries differ */
    {"simulate", "simulate " SMALL " --test 1 -o set", "set", NOTHING},
    {"offline", "simulate " SMALL " --binaries kernels -o offline", "offline", NOTHING},
    {"optics", "optics set/camera.json -o design", "design", NOTHING},
    {"fit", "fit set -o a.model --sums a.sums", "a.", WHOLE_FILES},
    {"psf", "fit --psf set/psf.tif --distances 100,171.4,600 -o psf.model", "psf.model", NOTHING},
    {"register", "register set --rotation 3 -o registered", "registered", NOTHING},
    {"train", "train set -m a.model -o b.model --steps 2 --hold-out 1 --show-every 0", "b.model", MEASURED},
    {"reconstruct", "reconstruct set/test/raw/test01.tif -m a.model -o pictures", "pictures", WHOLE_FILES},
    {"surface", "reconstruct set/test/raw/test01.tif -m a.model -o surface --scene surface --no-preview", "surface",
     WHOLE_FILES},
    {"fista", "reconstruct set/test/raw/test01.tif -m a.model -o fista --method fista --no-preview", "fista",
     WHOLE_FILES},
    {"evaluate", "evaluate pictures set/test/truth --json", NULL, NOTHING},
    {"tune", "tune -o tuning --size 15x14 --rounds 1", "tuning", MEASURED},
    {"bench", "bench -m a.model set/test/raw/test01.tif --quick --no-start --no-sweep -o speed", "speed", MEASURED},
};

#define COMMANDS (sizeof commands / sizeof *commands)

static const char *const kinds[FAULT_KINDS] = {"none", "memory", "opencl", "map", "file"};

/* What a run tells the program that started it; an undisturbed one also which calls to fail, where that is asked. */
typedef struct told {
    long calls, memory, objects;
    char struck[40];
    fault_chains chains;
} told;

typedef struct running {
    pid_t process;
    fault_kind kind;
    long n;
    told *told;
    char folder[400];
} running;

static struct {
    const char *folder;
    char whole[300]; /* where undisturbed runs have left their results */
    running jobs[MOST_JOBS];
    int wrong, most_jobs;
} all;

static void must(int fine, const char *what)
{
    if (fine)
        return;
    perror(what);
    exit(2);
}

/* The command in the folder, in this process, which ends with it. */
static void run_here(const fault_command *command, const running *job)
{
    static char words[1000];
    char *list[MOST_WORDS + 1] = {"hadalens"}, *rest;
    int count = 1;
    snprintf(words, sizeof words, "%s", command->words);
    for (char *word = strtok_r(words, " ", &rest); word && count < MOST_WORDS; word = strtok_r(NULL, " ", &rest))
        list[count++] = word;
    must(!chdir(job->folder), job->folder);
    setenv("TMPDIR", job->folder, 1);
    must(freopen("stdout", "w", stdout) && freopen("stderr", "w", stderr), "stdout");
    fault_watch(job->n ? SECONDS : UNDISTURBED * SECONDS, LOOK);
    if (fault_choice_asked() && !job->n)
        fault_chains_listen(&job->told->chains, fault_choice_asked());
    fault_arm(job->kind, job->n);
    const int code = hada_cli_main(count, list);
    job->told->memory = fault_memory_left();
    job->told->objects = fault_objects_alive();
    job->told->calls = fault_disarm();
    snprintf(job->told->struck, sizeof job->told->struck, "%s", fault_struck() ? fault_struck() : "nothing");
    exit(code);
}

static void start(running *job, const fault_command *command, fault_kind kind, long n)
{
    job->kind = kind;
    job->n = n;
    *job->told = (told){0};
    must(!tree_remove(job->folder) && !mkdir(job->folder, 0700), job->folder);
    must(!tree_link(all.whole, job->folder, command->output), all.whole); /* what the commands before have left */
    fflush(NULL);
    job->process = fork();
    must(job->process >= 0, "fork");
    if (!job->process)
        run_here(command, job);
}

/* What it said on stderr, the beginning of it; until it is asked again. */
static const char *said(const running *job)
{
    static char message[300];
    char path[500];
    snprintf(path, sizeof path, "%s/stderr", job->folder);
    FILE *file = fopen(path, "r");
    message[0] = '\0';
    if (file) {
        message[fread(message, 1, sizeof message - 1, file)] = '\0';
        fclose(file);
    }
    return message;
}

static void complain(const running *job, const fault_command *command, const char *what)
{
    printf("FAULT_ONLY=%s:%s:%ld (%s): %s; it said: %s\n", command->name, kinds[job->kind], job->n, job->told->struck,
           what, said(job));
    all.wrong++;
}

/* What it says on stderr is a message, or a note of what it went on without. */
static int says_something(const running *job)
{
    return strlen(said(job)) > 20;
}

/* Judges how a run ended. Returns whether it failed, as it may. */
static int judge(const running *job, const fault_command *command, int status)
{
    const int before = all.wrong, code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    const char *left = tree_hidden(job->folder);
    if (getenv("FAULT_TRACE"))
        printf("FAULT_ONLY=%s:%s:%ld (%s): exit code %d; it said: %s\n", command->name, kinds[job->kind], job->n,
               job->told->struck, code, said(job));
    if (code < 0)
        complain(job, command, WTERMSIG(status) == SIGALRM ? "it does not end" : "it crashed");
    else if (code > LAST_EXIT)
        complain(job, command, "an exit code that there is not");
    else if (code && !says_something(job))
        complain(job, command, "it failed without a message");
    if (left)
        complain(job, command, left);
    if (code >= 0 && (job->told->memory || job->told->objects))
        complain(job, command, job->told->memory ? "memory is left" : "OpenCL's objects are left");
    if (command->output && all.wrong == before) {
        tree_want want = !code                        ? (command->leaves == MEASURED ? TREE_NAMES : TREE_SAME)
                         : command->leaves == NOTHING ? TREE_NOTHING
                                                      : TREE_PARTS;
        if (!code && says_something(job))
            want = TREE_ANY;
        if (command->leaves == MEASURED && code)
            want = TREE_ANY;
        /* whether a name lasts, and whether all words were written, is asked when the result is there already */
        const int named = code && (strstr(said(job), "may not outlast") || !strcmp(job->told->struck, "fflush"));
        if (!tree_is(job->folder, all.whole, command->output, want) &&
            !(named && tree_is(job->folder, all.whole, command->output, TREE_SAME)))
            complain(job, command, code ? "half a result is left" : "another result than without the fault");
    }
    return code > 0;
}

/* Runs the command undisturbed, and keeps what it makes. */
static int undisturbed(const fault_command *command, fault_kind kind)
{
    running *job = &all.jobs[0];
    int status;
    start(job, command, kind, 0);
    must(waitpid(job->process, &status, 0) == job->process, "waitpid");
    job->process = 0;
    if (!WIFEXITED(status) || WEXITSTATUS(status) || job->told->memory || job->told->objects) {
        complain(job, command, "it failed without a fault, or left something");
        return 0;
    }
    if (command->output && !tree_has(all.whole, command->output))
        must(!tree_take(job->folder, all.whole, command->output), command->output);
    return 1;
}

static void wait_one(const fault_command *command, long *noticed)
{
    int status;
    const pid_t process = wait(&status);
    must(process > 0, "wait");
    for (int i = 0; i < all.most_jobs; i++)
        if (all.jobs[i].process == process) {
            *noticed += judge(&all.jobs[i], command, status);
            all.jobs[i].process = 0;
        }
}

/* The numbers of the calls that fail, in a list that is freed; all: how many there are to choose from. */
static long *choose(const told *seen, long only, long *count)
{
    const char *words = getenv("FAULT_RUNS");
    const long asked = words && !strcmp(words, "all") ? seen->calls : words ? atol(words) : 3;
    const int listed = fault_choice_asked() != FAULT_SPREAD;
    *count = only ? 1 : listed ? seen->chains.count : asked < seen->calls ? asked : seen->calls;
    long *list = calloc((size_t)*count + 1, sizeof *list);
    must(list != NULL, "memory");
    for (long r = 0; r < *count; r++) /* the middle of each share: the first and last calls are not all that is tried */
        list[r] = only ? only : listed ? seen->chains.first[r] : 1 + (2 * r + 1) * seen->calls / (2 * *count);
    return list;
}

static void fail_all(const fault_command *command, fault_kind kind, long only)
{
    const long calls = all.jobs[0].told->calls;
    long noticed = 0, runs, *list = choose(all.jobs[0].told, only, &runs);
    int busy = 0;
    for (long r = 0; r < runs; r++) {
        if (busy == all.most_jobs) {
            wait_one(command, &noticed);
            busy--;
        }
        int unused = 0;
        while (all.jobs[unused].process)
            unused++;
        start(&all.jobs[unused], command, kind, list[r]);
        busy++;
    }
    for (; busy; busy--)
        wait_one(command, &noticed);
    free(list);
    printf("%-12s %-7s %6ld calls, %5ld of %5ld faults noticed\n", command->name, kinds[kind], calls, noticed, runs);
    fflush(stdout);
}

static void make_jobs(void)
{
    const char *words = getenv("FAULT_JOBS");
    all.most_jobs = words ? atoi(words) : 1;
    if (all.most_jobs < 1 || all.most_jobs > MOST_JOBS)
        all.most_jobs = 1;
    for (int i = 0; i < all.most_jobs; i++) {
        running *job = &all.jobs[i];
        snprintf(job->folder, sizeof job->folder, "%s/run%d", all.folder, i);
        job->told = mmap(NULL, sizeof *job->told, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
        must(job->told != MAP_FAILED, "mmap");
    }
}

/* Whether a command is asked for, or makes something that one of those takes that are. */
static int is_needed(size_t c, const char *only)
{
    if (!only || !strncmp(only, commands[c].name, strcspn(only, ":")))
        return 1;
    for (size_t later = c + 1; later < COMMANDS && commands[c].output; later++)
        if (strstr(commands[later].words, commands[c].output) && is_needed(later, only))
            return 1;
    return 0;
}

int main(int argc, char **argv)
{
    const char *only = getenv("FAULT_ONLY");
    must(argc == 2, "fault_commands FOLDER");
    all.folder = argv[1];
    snprintf(all.whole, sizeof all.whole, "%s/whole", all.folder);
    must(!tree_remove(all.folder) && !mkdir(all.folder, 0700) && !mkdir(all.whole, 0700), all.folder);
    setenv("HADALENS_CACHE", "off", 1); /* PoCL's own serves: what is compiled does not depend on the run before */
    make_jobs();
    for (size_t c = 0; c < COMMANDS; c++) {
        const fault_command *command = &commands[c];
        if (!is_needed(c, only))
            continue;
        const int skipped = only && strncmp(only, command->name, strcspn(only, ":"));
        for (fault_kind kind = FAULT_MEMORY; kind < FAULT_KINDS; kind++) {
            char name[64];
            snprintf(name, sizeof name, "%s:%s:", command->name, kinds[kind]);
            const int here = !only || (!strncmp(only, name, strlen(name)) || !strncmp(only, name, strlen(only)));
            if (kind > FAULT_MEMORY && !here)
                continue;
            if (undisturbed(command, kind) && all.jobs[0].told->calls && here && !skipped)
                fail_all(command, kind, only && strlen(only) > strlen(name) ? atol(only + strlen(name)) : 0);
        }
    }
    printf("%d wrong\n", all.wrong);
    if (!all.wrong)
        tree_remove(all.folder);
    return all.wrong ? 1 : 0;
}
