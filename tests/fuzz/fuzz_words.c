/* Texts, names and folders. */
#include <fcntl.h>
#include <hadalens/dataset.h>
#include <hadalens/limits.h>
#include <hadalens/net.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "fuzz.h"
#include "io/positions.h"
#include "io/text.h"
#include "io/tiff_meta.h"
#include "netlist/net_list.h"
#include "option.h"
#include "runtime/program.h"
#include "runtime/tuning.h"
#include "tasks/train_log.h"

static void write_file(const char *path, const uint8_t *data, size_t bytes)
{
    const int fd = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd >= 0 && write(fd, data, bytes) != (ssize_t)bytes)
        abort();
    if (fd >= 0)
        close(fd);
}

/* Rows and columns go before the list. */
void fuzz_list(const uint8_t *data, size_t bytes)
{
    hada_net *net;
    hada_error err = {0};
    const size_t head = bytes < 2 ? bytes : 2;
    char *text = fuzz_text(data + head, bytes - head), *back = NULL;
    const hada_status status = hada_net_create(&net, text, 1, &err);
    fuzz_check(status, &err);
    if (!status) {
        const hada_net_info *info = hada_net_get_info(net);
        hada_size *sizes = calloc((size_t)info->layers, sizeof *sizes);
        fuzz_check(hada_net_sizes(net, data[0] + 1, data[1] + 1, sizes, &err), &err);
        fuzz_check(hada_net_describe(net, &back, &err), &err);
        free(sizes);
        free(back);
        hada_net_destroy(&net);
    }
    free(text);
}

void fuzz_tuning(const uint8_t *data, size_t bytes)
{
    hada_tuning *tuning;
    hada_error err = {0};
    fuzz_check_file(hada_tuning_read(&tuning, fuzz_path(data, bytes), &err), &err);
    hada_tuning_destroy(&tuning);
}

void fuzz_binary(const uint8_t *data, size_t bytes)
{
    hada_error err = {0};
    unsigned char *binary;
    size_t length;
    const char *folder = fuzz_folder();
    char path[100];
    snprintf(path, sizeof path, "%s/x.bin", folder);
    write_file(path, data, bytes);
    fuzz_check_file(hada_binary_read(folder, "x.bin", &binary, &length, &err), &err);
    if (length && length >= bytes)
        abort();
    free(binary);
}

void fuzz_positions(const uint8_t *data, size_t bytes)
{
    hada_positions positions;
    hada_error err = {0};
    const hada_status status = hada_positions_read(&positions, fuzz_path(data, bytes), &err);
    fuzz_check_file(status, &err);
    if (!status && (positions.count < 1 || (positions.depths && positions.count % positions.depths)))
        abort();
    hada_positions_free(&positions);
}

/* A line is a file of the folder, with those above it. */
void fuzz_dataset(const uint8_t *data, size_t bytes)
{
    hada_dataset *set;
    hada_dataset_options options;
    hada_error err = {0};
    const char *folder = fuzz_folder();
    char *text = fuzz_text(data, bytes), *rest;
    int files = 0;
    for (char *line = strtok_r(text, "\n", &rest); line && files < 40; line = strtok_r(NULL, "\n", &rest), files++) {
        char path[300];
        if (snprintf(path, sizeof path, "%s/%s", folder, line) >= (int)sizeof path || strstr(line, ".."))
            continue;
        for (char *at = path + strlen(folder) + 1; (at = strchr(at, '/')); *at++ = '/') {
            *at = '\0';
            mkdir(path, 0700);
        }
        write_file(path, data, 1);
    }
    free(text);
    hada_dataset_options_init(&options);
    options.skip_incomplete = bytes & 1;
    const hada_status status = hada_dataset_scan(&set, folder, &options, &err);
    fuzz_check(status, &err);
    if (status)
        return;
    hada_dataset *learn, *held;
    const hada_status split = hada_dataset_split(set, 0.25, &learn, &held, &err);
    fuzz_check(split, &err);
    if (!split) {
        hada_dataset_destroy(&learn);
        hada_dataset_destroy(&held);
    }
    hada_dataset_destroy(&set);
}

/* A training that goes on reads both of its tables. */
void fuzz_log(const uint8_t *data, size_t bytes)
{
    hada_train_log log = {0};
    hada_error err = {0};
    const char *folder = fuzz_folder();
    char path[100];
    snprintf(path, sizeof path, "%s/losses.csv", folder);
    write_file(path, data, bytes);
    snprintf(path, sizeof path, "%s/validation.csv", folder);
    write_file(path, data, bytes);
    fuzz_check_file(hada_train_log_open(&log, folder, 1, 1000, &err), &err);
    hada_train_log_close(&log);
}

void fuzz_words(const uint8_t *data, size_t bytes)
{
    hada_limits limits;
    hada_error err = {0};
    char *text = fuzz_text(data, bytes);
    const char *end;
    hada_limits_init(&limits);
    fuzz_check(hada_limits_parse(&limits, text, &err), &err);
    hada_text_number(text, &end);
    if (end < text || end > text + strlen(text))
        abort();
    hada_text_line(text, "key");
    free(text);
}

/* A word a line; the first is the command. */
void fuzz_options(const uint8_t *data, size_t bytes)
{
    enum { MOST_WORDS = 40 };
    const char *words[MOST_WORDS + 1] = {NULL};
    hada_cli_parsed parsed;
    hada_error err = {0};
    char *text = fuzz_text(data, bytes), *rest;
    int count = 0;
    for (char *word = strtok_r(text, "\n", &rest); word && count < MOST_WORDS; word = strtok_r(NULL, "\n", &rest))
        words[count++] = word;
    const hada_cli_command *command = count ? hada_cli_find_command(words[0]) : NULL;
    if (command) {
        fuzz_check(hada_cli_parse(&parsed, command, count, words, &err), &err);
        hada_cli_parsed_free(&parsed);
    }
    free(text);
}
