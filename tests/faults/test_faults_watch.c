/* A process that does not get on is ended, one that does is not, however long it takes; memory that a thread is still
 * to give back is not called left. */
#include <pthread.h>
#include <signal.h>
#include <sys/wait.h>
#include <time.h>

#include "fault.h"
#include "fault_watch.h"
#include "testing.h"

static double seconds_of(clockid_t clock)
{
    struct timespec now;
    clock_gettime(clock, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void work_for(clockid_t clock, double seconds)
{
    for (const double start = seconds_of(clock); seconds_of(clock) - start < seconds;)
        continue;
}

/* How a process ends that does `work` under the watch. */
static int end_of(void (*work)(void), unsigned most, unsigned look)
{
    int status = 0;
    fflush(NULL);
    const pid_t process = fork();
    assert_true(process >= 0);
    if (!process) {
        fault_watch(most, look);
        work();
        _exit(0);
    }
    assert_int_equal(waitpid(process, &status, 0), process);
    return status;
}

static void work_for_ever(void)
{
    for (;;)
        work_for(CLOCK_PROCESS_CPUTIME_ID, 1.0);
}

static void wait_for_ever(void)
{
    for (;;)
        pause();
}

static void work_through_looks(void)
{
    work_for(CLOCK_MONOTONIC, 5.5);
}

TEST(test_ends)
{
    int status = end_of(work_for_ever, 1, 1);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM);
    status = end_of(wait_for_ever, 1000, 2);
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGALRM);
    status = end_of(work_through_looks, 1000, 2);
    assert_true(WIFEXITED(status) && !WEXITSTATUS(status));
}

static void *wait_on(void *user)
{
    pthread_mutex_lock(user);
    pthread_mutex_unlock(user);
    return NULL;
}

static void *free_late(void *user)
{
    work_for(CLOCK_THREAD_CPUTIME_ID, 1.0);
    free(user);
    return NULL;
}

TEST(test_left)
{
    if (access("/proc/self/task", R_OK))
        skip();
    pthread_t thread, waiting;
    pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    fault_looks = 20; /* a tenth of a second */
    pthread_mutex_lock(&lock);
    assert_int_equal(pthread_create(&waiting, NULL, wait_on, &lock), 0);
    fault_arm(FAULT_MEMORY, 0);
    void *memory = malloc(1);
    assert_non_null(memory);
    assert_int_equal(fault_memory_left(), 1); /* nobody is about to free it */
    assert_int_equal(pthread_create(&thread, NULL, free_late, memory), 0);
    while (!fault_others_work())
        usleep(1000);
    assert_int_equal(fault_memory_left(), 0);
    pthread_join(thread, NULL);
    fault_disarm();
    pthread_mutex_unlock(&lock);
    pthread_join(waiting, NULL);
}
