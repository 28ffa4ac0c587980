/* The books, and the wrappers of the allocator. */
#include <errno.h>
#include <locale.h>
#include <pthread.h>
#include <stdarg.h>

#include "fault.h"
#include "fault_watch.h"

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
void (*fault_counted)(long n);

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

int fault_looks = 4000;

long fault_memory_left(void)
{
    enum { LOOK_US = 5000 };
    for (int idle = 0; fault_memory_alive() && idle < fault_looks; idle += !fault_others_work())
        usleep(LOOK_US);
    return fault_memory_alive();
}

long fault_objects_alive(void)
{
    return books.objects;
}

int fault_here(fault_kind kind, const char *name)
{
    int here = 0;
    pthread_mutex_lock(&books.lock);
    const long n = books.armed && kind == books.kind ? ++books.count : 0;
    if (n && n == books.n) {
        books.struck = name;
        here = 1;
    }
    pthread_mutex_unlock(&books.lock);
    if (n && fault_counted)
        fault_counted(n);
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

/* The call that fails, as the true one would. */
static int fails(const char *name)
{
    const int here = fault_here(FAULT_MEMORY, name);
    if (here)
        errno = ENOMEM;
    return here;
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
    return fails("malloc") ? NULL : born(__real_malloc(bytes));
}

void *__wrap_calloc(size_t count, size_t bytes)
{
    return fails("calloc") ? NULL : born(__real_calloc(count, bytes));
}

void *__wrap_realloc(void *pointer, size_t bytes)
{
    if (fails("realloc"))
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
    return fails("aligned_alloc") ? NULL : born(__real_aligned_alloc(alignment, bytes));
}

void __wrap_free(void *pointer)
{
    died(pointer);
    __real_free(pointer);
}

char *__real_strdup(const char *text);
char *__real_strndup(const char *text, size_t most);
FILE *__real_open_memstream(char **out, size_t *bytes);
int __real_vasprintf(char **out, const char *format, va_list arguments);
char *__wrap_strdup(const char *text);
char *__wrap_strndup(const char *text, size_t most);
FILE *__wrap_open_memstream(char **out, size_t *bytes);
int __wrap_vasprintf(char **out, const char *format, va_list arguments);

char *__wrap_strdup(const char *text)
{
    return fails("strdup") ? NULL : born(__real_strdup(text));
}

char *__wrap_strndup(const char *text, size_t most)
{
    return fails("strndup") ? NULL : born(__real_strndup(text, most));
}

int __wrap_vasprintf(char **out, const char *format, va_list arguments)
{
    const int length = fails("vasprintf") ? -1 : __real_vasprintf(out, format, arguments);
    if (length >= 0)
        born(*out);
    return length;
}

FILE *__wrap_open_memstream(char **out, size_t *bytes)
{
    return fails("open_memstream") ? NULL : __real_open_memstream(out, bytes);
}

locale_t __real_newlocale(int what, const char *name, locale_t base);
locale_t __wrap_newlocale(int what, const char *name, locale_t base);
locale_t __wrap_newlocale(int what, const char *name, locale_t base)
{
    return fails("newlocale") ? (locale_t)0 : __real_newlocale(what, name, base);
}

/* A system that is short of memory gives no threads either. */
int __real_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user);
int __wrap_pthread_create(pthread_t *thread, const pthread_attr_t *how, void *(*work)(void *), void *user)
{
    return fault_here(FAULT_MEMORY, "pthread_create") ? EAGAIN : __real_pthread_create(thread, how, work, user);
}
