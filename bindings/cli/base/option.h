/* Options as data: one table per command, from which come the parser, --help and the manual pages. */
#ifndef HADA_CLI_OPTION_H
#define HADA_CLI_OPTION_H

#include <hadalens/folder.h>

#include "cli.h"

typedef enum hada_cli_kind {
    HADA_OPTION_GROUP = 0, /* a heading; only `help` is used */
    HADA_OPTION_FLAG,      /* int: 1 when given */
    HADA_OPTION_TEXT,      /* const char * */
    HADA_OPTION_TARGET,    /* const char *: what is written; every other text may name an input */
    HADA_OPTION_TEXTS,     /* hada_cli_texts: may be given more than once */
    HADA_OPTION_REAL,      /* double, not negative */
    HADA_OPTION_COUNT,     /* int, not negative */
    HADA_OPTION_STEPS,     /* the same as uint64_t */
    HADA_OPTION_SEED,      /* uint64_t */
    HADA_OPTION_WEIGHT,    /* double, not negative, or "auto": HADA_AUTO */
    HADA_OPTION_PASSES,    /* int, not negative, or "auto" */
    HADA_OPTION_SIZE,      /* int[2]: "HxW", rows first */
    HADA_OPTION_CHOICE,    /* int: the value (below) of the word in "a|b|c" */
    HADA_OPTION_WORD       /* const char *: one of "a|b|c" */
} hada_cli_kind;

typedef struct hada_cli_option {
    hada_cli_kind kind;
    const char *name;     /* without the dashes */
    char letter;          /* 0: none */
    const char *argument; /* "FILE", "a|b|c"; NULL for flags */
    const char *help;     /* one line */
    const char *more;     /* further sentences for --help and the manual, or NULL */
    size_t offset;        /* of the value in the command's settings */
    const int *values; /* of a choice: what each word of `argument` stands for, in their order; of a weight: the least
                          and the most, NULL: from 0 on */
} hada_cli_option;

/* The ends of rows: where the value goes, and what the words of a choice stand for. */
/* clang-format off */
#define HADA_CLI_AT(settings, member)          offsetof(settings, member), NULL
#define HADA_CLI_ONE_OF(settings, member, ...) offsetof(settings, member), (const int[]){__VA_ARGS__}
#define HADA_CLI_GROUP(text)                   {HADA_OPTION_GROUP, NULL, 0, NULL, text, NULL, 0, NULL}
/* clang-format on */

#define HADA_CLI_TEXTS 64
typedef struct hada_cli_texts {
    int count;
    const char *items[HADA_CLI_TEXTS];
} hada_cli_texts;

typedef struct hada_cli_example {
    const char *line, *what;
} hada_cli_example;

typedef struct hada_cli_command {
    const char *name, *summary, *synopsis;
    const char *description;          /* paragraphs, each ended by \n\n or the end */
    const hada_cli_option *options;   /* ended by a row without help */
    const hada_cli_example *examples; /* ended by a row without line */
    const char *const *renamed;       /* old and new names of options in turn, ended by NULL; understood, not shown */
    size_t settings_size;
    const char *decides; /* an option that the defaults of others go by: stored before `defaults`; NULL: none */
    void (*defaults)(void *settings);
    int (*run)(hada_cli *cli, void *settings, int count, const char **arguments);
    int uses_device;    /* has --device and --binaries */
    int designs_camera; /* has the options of camera_options.h */
    int records_frames; /* and of sensor_options.h */
    int shared;         /* ranks can share it (bindings/mpi) */
} hada_cli_command;

/* Tables that are appended to those of the commands. */
extern const hada_cli_option hada_cli_camera_options[];
extern const hada_cli_option hada_cli_sensor_options[];
extern const hada_cli_option hada_cli_device_options[];
extern const hada_cli_option hada_cli_common_options[];

/* The commands, ended by a row without name. */
extern const hada_cli_command *const hada_cli_commands[];
const hada_cli_command *hada_cli_find_command(const char *name);

/* Calls `visit` for every row of a command's tables. */
void hada_cli_each_option(const hada_cli_command *command, void (*visit)(void *user, const hada_cli_option *option),
                          void *user);

/* A parsed command line. */
typedef struct hada_cli_parsed {
    void *settings;
    int count;
    const char **arguments; /* what is not an option */
    void *popt;
    char **texts; /* values of options, freed with the rest */
    int text_count;
    hada_inputs *inputs; /* files that the command line names, kept from being overwritten */
} hada_cli_parsed;

/* Parses; HADA_ERROR_ARGUMENT with a message that names the option and, for a misspelt one, the nearest. */
hada_status hada_cli_parse(hada_cli_parsed *parsed, const hada_cli_command *command, int argc, const char **argv,
                           hada_error *err);
void hada_cli_parsed_free(hada_cli_parsed *parsed);

/* Text for --help and for manual pages. */
void hada_cli_print_help(const hada_cli_command *command);
void hada_cli_print_overview(void);
/* A manual page in troff; command NULL: that of the program itself. */
void hada_cli_print_man(const hada_cli_command *command);

extern const char *const hada_cli_exit_texts[]; /* "0  all is well", ... ended by NULL */

/* The nearest of some words to a misspelt one, NULL when none is near. */
typedef struct hada_cli_nearest {
    const char *word, *best;
    int distance;
} hada_cli_nearest;
void hada_cli_nearest_try(hada_cli_nearest *nearest, const char *candidate);

/* Values. All numbers are read with a point, whatever the locale, and must use the whole text. */
int hada_cli_read_real(const char *text, double *value);
int hada_cli_read_count(const char *text, int *value);
int hada_cli_read_size(const char *text, int size[2]);

/* "1,3-5" (slices counted from 1) or "100mm,250mm" (distances, the nearest within 1 %): indices of a list of
 * distances, ascending, without repeats. `out` holds `count` values. */
hada_status hada_cli_read_depths(const char *option, const char *text, const double *distances_mm, int count, int *out,
                                 int *found, hada_error *err);

/* "100,250.5": distances in millimetres, ascending; NULL: none. */
hada_status hada_cli_read_distances(const char *option, const char *text, double *out, int capacity, int *found,
                                    hada_error *err);

/* A colour matrix (hada_fit_options); *find: 1: none is given, but it may be found. */
hada_status hada_cli_read_colours(const char *text, double matrix[9], int *find, hada_error *err);

/* The commands, each in its own cmd_*.c. */

extern const hada_cli_command hada_cli_devices;
extern const hada_cli_command hada_cli_simulate;
extern const hada_cli_command hada_cli_optics;
extern const hada_cli_command hada_cli_register;
extern const hada_cli_command hada_cli_fit;
extern const hada_cli_command hada_cli_train;
extern const hada_cli_command hada_cli_reconstruct;
extern const hada_cli_command hada_cli_evaluate;
extern const hada_cli_command hada_cli_tune;
extern const hada_cli_command hada_cli_bench;

#endif
