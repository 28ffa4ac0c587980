/* The books, and the wrappers of the allocator. */
#include <errno.h>
#include <pthread.h>
#include <stdlib.h>

#include "fault.h"

enum { SLOTS = 1 << 16 };

static struct {
    pthread_mutex_t lock;
    int armed;
    fault_kind kind;
    long n, count, memory, objects;
    const char *struck;
    void *alive[SLOTS]; /* open addressing; `gone` marks a freed place */
} books = {.lock = PTHREAD_MUTEX_INITIALIZER};
static char gone;

fault_device fault_pretend;

void fault_arm(fault_kind kind, long n)
{
    pthread_mutex_lock(&books.lock);
    for (size_t i = 0; i < SLOTS; i++)
        books.alive[i] = NULL;
    books.memory = books.objects = books.count = 0;
    books.kind = kind;
    books.n = n;
    books.struck = NULL;
    books.armed = 1;
    pthread_mutex_unlock(&books.lock);
}

long fault_disarm(void)
{
    pthread_mutex_lock(&books.lock);
    books.armed = 0;
    long count = books.count;
    pthread_mutex_unlock(&books.lock);
    return count;
}

const char *fault_struck(void)
{
    return books.struck;
}

long fault_memory_alive(void)
{
    return books.memory;
}

long fault_objects_alive(void)
{
    return books.objects;
}

int fault_here(fault_kind kind, const char *name)
{
    int here = 0;
    pthread_mutex_lock(&books.lock);
    if (books.armed && kind == books.kind && ++books.count == books.n) {
        books.struck = name;
        here = 1;
    }
    pthread_mutex_unlock(&books.lock);
    return here;
}

void fault_object(int change)
{
    pthread_mutex_lock(&books.lock);
    books.objects += books.armed ? change : 0;
    pthread_mutex_unlock(&books.lock);
}

static size_t place_of(const void *pointer)
{
    return (size_t)(((uintptr_t)pointer >> 4) * 0x9e3779b97f4a7c15u >> 48) % SLOTS;
}

static void *born(void *pointer)
{
    pthread_mutex_lock(&books.lock);
    if (pointer && books.armed && books.memory < SLOTS / 2) {
        size_t i = place_of(pointer);
        while (books.alive[i] && books.alive[i] != &gone)
            i = (i + 1) % SLOTS;
        books.alive[i] = pointer;
        books.memory++;
    }
    pthread_mutex_unlock(&books.lock);
    return pointer;
}

static int died(const void *pointer)
{
    int known = 0;
    pthread_mutex_lock(&books.lock);
    if (pointer && books.armed)
        for (size_t i = place_of(pointer), n = 0; books.alive[i] && n < SLOTS; i = (i + 1) % SLOTS, n++)
            if (books.alive[i] == pointer) {
                books.alive[i] = &gone;
                books.memory--;
                known = 1;
                break;
            }
    pthread_mutex_unlock(&books.lock);
    return known;
}

void *__real_malloc(size_t bytes);
void *__real_calloc(size_t count, size_t bytes);
void *__real_realloc(void *pointer, size_t bytes);
void *__real_aligned_alloc(size_t alignment, size_t bytes);
void __real_free(void *pointer);
void *__wrap_malloc(size_t bytes);
void *__wrap_calloc(size_t count, size_t bytes);
void *__wrap_realloc(void *pointer, size_t bytes);
void *__wrap_aligned_alloc(size_t alignment, size_t bytes);
void __wrap_free(void *pointer);

void *__wrap_malloc(size_t bytes)
{
    return fault_here(FAULT_MEMORY, "malloc") ? NULL : born(__real_malloc(bytes));
}

void *__wrap_calloc(size_t count, size_t bytes)
{
    return fault_here(FAULT_MEMORY, "calloc") ? NULL : born(__real_calloc(count, bytes));
}

void *__wrap_realloc(void *pointer, size_t bytes)
{
    if (fault_here(FAULT_MEMORY, "realloc"))
        return NULL;
    const int known = died(pointer);
    void *moved = __real_realloc(pointer, bytes);
    if (moved)
        return pointer && !known ? moved : born(moved);
    if (known)
        born(pointer);
    return NULL;
}

void *__wrap_aligned_alloc(size_t alignment, size_t bytes)
{
    return fault_here(FAULT_MEMORY, "aligned_alloc") ? NULL : born(__real_aligned_alloc(alignment, bytes));
}

void __wrap_free(void *pointer)
{
    died(pointer);
    __real_free(pointer);
}

/* A system that is short of memory gives no threads either. */
int __real_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user)
{
    return fault_here(FAULT_MEMORY, "pthread_create") ? EAGAIN : __real_pthread_create(thread, how, work, user);
}
