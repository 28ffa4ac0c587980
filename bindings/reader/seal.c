#include "reader.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/landlock.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <unistd.h>

#if defined(__x86_64__)
#define ARCHITECTURE AUDIT_ARCH_X86_64
#elif defined(__aarch64__)
#define ARCHITECTURE AUDIT_ARCH_AARCH64
#endif

/* Calls that are let through as they are. */
static const int allowed[] = {
    SYS_read,          SYS_write,     SYS_pread64,     SYS_pwrite64,        SYS_lseek,
    SYS_close,         SYS_fstat,     SYS_ftruncate,   SYS_munmap,          SYS_mremap,
    SYS_brk,           SYS_madvise,   SYS_futex,       SYS_rt_sigaction,    SYS_rt_sigprocmask,
    SYS_rt_sigreturn,  SYS_exit,      SYS_exit_group,  SYS_getpid,          SYS_gettid,
    SYS_clock_gettime, SYS_getrandom, SYS_sched_yield, SYS_restart_syscall, SYS_getrusage,
#ifdef SYS_gettimeofday
    SYS_gettimeofday,
#endif
};

enum { MOST = 160 };

typedef struct program {
    struct sock_filter code[MOST];
    unsigned short count;
} program;

static void add(program *to, unsigned short code, uint32_t k, unsigned char yes, unsigned char no)
{
    if (to->count < MOST)
        to->code[to->count++] = (struct sock_filter){code, yes, no, k};
}

static void answer(program *to, uint32_t what)
{
    add(to, BPF_RET | BPF_K, what, 0, 0);
}

/* The rest is about this call; ended by answer(). */
static void on_call(program *to, int call, unsigned char length)
{
    add(to, BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr), 0, 0);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, (uint32_t)call, 0, length);
}

/* Lets a call through whose argument, masked, has this value (the lower half: all are small numbers). */
static void allow_where(program *to, int call, unsigned argument, uint32_t mask, uint32_t value)
{
    const size_t at = offsetof(struct seccomp_data, args) + argument * sizeof(uint64_t) +
                      (__BYTE_ORDER__ == __ORDER_BIG_ENDIAN__ ? sizeof(uint32_t) : 0);
    on_call(to, call, 5);
    add(to, BPF_LD | BPF_W | BPF_ABS, (uint32_t)at, 0, 0);
    add(to, BPF_ALU | BPF_AND | BPF_K, mask, 0, 0);
    add(to, BPF_JMP | BPF_JEQ | BPF_K, value, 0, 1);
    answer(to, SECCOMP_RET_ALLOW);
    answer(to, SECCOMP_RET_ERRNO | EACCES);
}

static int filter_calls(int reopens)
{
#ifndef ARCHITECTURE
    (void)reopens;
    return -1;
#else
    program filter = {.count = 0};
    add(&filter, BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, arch), 0, 0);
    add(&filter, BPF_JMP | BPF_JEQ | BPF_K, ARCHITECTURE, 1, 0);
    answer(&filter, SECCOMP_RET_KILL_PROCESS);
    for (size_t i = 0; i < sizeof allowed / sizeof *allowed; i++) {
        on_call(&filter, allowed[i], 1);
        answer(&filter, SECCOMP_RET_ALLOW);
    }
    /* memory, but no code; fstat() alone of those that look at files; a limit of its own; its own end by a signal */
    allow_where(&filter, SYS_mmap, 2, PROT_EXEC, 0);
    allow_where(&filter, SYS_mprotect, 2, PROT_EXEC, 0);
    allow_where(&filter, SYS_newfstatat, 3, AT_EMPTY_PATH, AT_EMPTY_PATH);
    allow_where(&filter, SYS_prlimit64, 0, UINT32_MAX, 0);
    allow_where(&filter, SYS_tgkill, 0, UINT32_MAX, (uint32_t)getpid());
    if (reopens) { /* Landlock allows one file */
        on_call(&filter, SYS_openat, 1);
        answer(&filter, SECCOMP_RET_ALLOW);
        on_call(&filter, SYS_fcntl, 1);
        answer(&filter, SECCOMP_RET_ALLOW);
        on_call(&filter, SYS_flock, 1);
        answer(&filter, SECCOMP_RET_ALLOW);
    }
    answer(&filter, SECCOMP_RET_ERRNO | EACCES);
    const struct sock_fprog given = {filter.count, filter.code};
    return filter.count == MOST ? -1 : prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &given, 0, 0);
#endif
}

/* Needed only where files may be opened; elsewhere a second lock on the same door. */
static int restrict_files(int file, int reopens)
{
    const struct landlock_ruleset_attr all = {.handled_access_fs = (LANDLOCK_ACCESS_FS_MAKE_SYM << 1) - 1};
    const struct landlock_path_beneath_attr one = {.allowed_access = LANDLOCK_ACCESS_FS_READ_FILE, .parent_fd = file};
    const int rules = (int)syscall(SYS_landlock_create_ruleset, &all, sizeof all, 0);
    if (rules < 0)
        return -1;
    const int failed = (reopens && syscall(SYS_landlock_add_rule, rules, LANDLOCK_RULE_PATH_BENEATH, &one, 0)) ||
                       syscall(SYS_landlock_restrict_self, rules, 0);
    close(rules);
    return failed;
}

int hada_seal(int file, int reopens)
{
    if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) || (restrict_files(file, reopens) && reopens))
        return -1;
    return filter_calls(reopens);
}
