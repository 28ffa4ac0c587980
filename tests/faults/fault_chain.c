#include "fault_chain.h"

#include <execinfo.h>
#include <pthread.h>

#include "fault.h"

/* Frames of a chain: from the wrapper up to the command or the stage. */
enum { FRAMES = 24 };

static struct {
    pthread_mutex_t lock;
    fault_chains *to;
    fault_choice choice;
} listening = {.lock = PTHREAD_MUTEX_INITIALIZER};

fault_choice fault_choice_asked(void)
{
    const char *words = getenv("FAULT_RUNS");
    return !words                     ? FAULT_SPREAD
           : !strcmp(words, "chains") ? FAULT_CHAINS
           : !strcmp(words, "sites")  ? FAULT_SITES
                                      : FAULT_SPREAD;
}

/* Whether the value was not known before; it is now. */
static int is_new(fault_chains *to, uint64_t value)
{
    const uint64_t places = 2 * FAULT_MOST_CHAINS;
    uint64_t at = (value * 0x9e3779b97f4a7c15u >> 40) % places;
    while (to->seen[at] && to->seen[at] != value)
        at = (at + 1) % places;
    if (to->seen[at] || to->known == FAULT_MOST_CHAINS)
        return 0;
    to->seen[at] = value;
    to->known++;
    return 1;
}

/* A call is the same as another where the same lines have led to it. */
static void note(long n)
{
    void *frames[FRAMES];
    const int count = backtrace(frames, FRAMES);
    uint64_t whole = 1;
    int chosen = 0;
    pthread_mutex_lock(&listening.lock);
    fault_chains *to = listening.to;
    for (int i = 0; to && i < count; i++) {
        const uint64_t site = (uint64_t)(uintptr_t)frames[i];
        whole = (whole ^ site) * 0x9e3779b97f4a7c15u;
        if (listening.choice == FAULT_SITES)
            chosen |= is_new(to, site);
    }
    if (to && listening.choice == FAULT_CHAINS)
        chosen = is_new(to, whole);
    if (chosen && to->count < FAULT_MOST_CHAINS)
        to->first[to->count++] = n;
    pthread_mutex_unlock(&listening.lock);
}

void fault_chains_listen(fault_chains *to, fault_choice choice)
{
    pthread_mutex_lock(&listening.lock);
    listening.to = to;
    listening.choice = choice;
    if (to)
        memset(to, 0, sizeof *to);
    pthread_mutex_unlock(&listening.lock);
    fault_counted = to ? note : NULL;
}
