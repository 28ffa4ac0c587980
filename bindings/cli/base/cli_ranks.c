/* A command that several ranks share: who writes, on which device, with which exit code. */
#include "cli.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int hada_cli_writes(const hada_cli *cli)
{
    return !cli->ranks || !cli->ranks->communicator.rank;
}

const hada_communicator *hada_cli_communicator(const hada_cli *cli)
{
    return cli->ranks ? &cli->ranks->communicator : NULL;
}

/* The n-th entry of a list, counted round. */
static void take_entry(const char *list, int n, char *words, size_t size)
{
    int count = 1;
    for (const char *at = list; *at; at++)
        count += *at == ',';
    for (n %= count; n; n--)
        list = strchr(list, ',') + 1;
    snprintf(words, size, "%.*s", (int)strcspn(list, ","), list);
}

/* The machine's n-th accelerator, counted round, or a part of its first device where it has none. */
static void choose(const hada_cli_ranks *ranks, char *words, size_t size)
{
    hada_device_list *list = NULL;
    size_t accelerators = 0, found = 0;
    *words = '\0';
    if (hada_device_list_create(&list, NULL))
        return;
    const size_t count = hada_device_list_count(list);
    for (size_t i = 0; i < count; i++)
        accelerators += hada_device_list_get(list, i)->kind != HADA_DEVICE_CPU;
    for (size_t i = 0; accelerators && i < count; i++)
        if (hada_device_list_get(list, i)->kind != HADA_DEVICE_CPU && found++ == (size_t)ranks->local % accelerators)
            snprintf(words, size, "%zu", i);
    const hada_device_info *first = count ? hada_device_list_get(list, 0) : NULL;
    if (!accelerators && first && ranks->locals > 1 && first->max_sub_devices >= (unsigned)ranks->locals)
        snprintf(words, size, "0:%d/%d", ranks->local + 1, ranks->locals);
    hada_device_list_destroy(&list);
}

void hada_cli_take_device(const hada_cli_ranks *ranks, hada_cli_common *common, char *words, size_t size)
{
    const char *named = common->device ? common->device : getenv("HADALENS_DEVICE");
    if (named && *named)
        take_entry(named, ranks->local, words, size);
    else
        choose(ranks, words, size);
    if (*words)
        common->device = words;
}

long hada_cli_sum(const hada_cli *cli, long count)
{
    const hada_communicator *all = hada_cli_communicator(cli);
    double sum = (double)count;
    if (all && all->count > 1 && all->reduce(all->user, &sum, 1, NULL))
        return count;
    return (long)sum;
}

/* Codes of all ranks: the same, or HADA_EXIT_SOME where they failed for different reasons. */
int hada_cli_agree(hada_cli *cli, int code)
{
    enum { CODES = 256 };
    double codes[CODES] = {0};
    int agreed = HADA_EXIT_OK;
    const hada_communicator *all = hada_cli_communicator(cli);
    if (!all || all->count == 1)
        return code;
    codes[code & (CODES - 1)] = 1;
    if (all->reduce(all->user, codes, CODES, NULL))
        return HADA_EXIT_SOME;
    *cli->ranks->agreed = 1;
    for (int i = CODES - 1; i > 0; i--)
        if (codes[i] > 0)
            agreed = agreed ? HADA_EXIT_SOME : i;
    return agreed;
}

/* The text of a rank, on all of them. */
static char *share(const hada_communicator *all, int root, char *text)
{
    size_t length = text ? strlen(text) : 0;
    if (all->broadcast(all->user, root, &length, sizeof length, NULL))
        return NULL;
    char *copy = hada_cli_memory(length + 1, 1);
    if (text)
        memcpy(copy, text, length + 1);
    all->broadcast(all->user, root, copy, length, NULL);
    return copy;
}

void hada_cli_gather(hada_cli *cli, const char *key)
{
    const hada_communicator *all = hada_cli_communicator(cli);
    json_t *own = json_object_get(cli->document, key);
    for (int rank = 1; all && rank < all->count; rank++) {
        char *text = all->rank == rank && own ? json_dumps(own, 0) : NULL;
        char *copy = share(all, rank, text);
        json_t *more = !all->rank && copy ? json_loads(copy, 0, NULL) : NULL;
        if (more && own)
            json_array_extend(own, more);
        json_decref(more);
        free(copy);
        free(text);
    }
}
