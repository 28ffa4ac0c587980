/* Only in the program for tests: does what the first word of a file says. */
#include "misbehave.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

/* What is refused ends with this code, as a codec would that minds; what is not, with another. */
enum { REFUSED = 13, GRANTED = 77 };

static void tried(long result)
{
    _exit(result < 0 && (errno == EACCES || errno == EPERM || errno == EAGAIN) ? REFUSED : GRANTED);
}

void hada_misbehave(int file)
{
    static const char suspect[] = "MATLAB 7.3 "; /* which is decoded by this process by default */
    char head[32] = "";
    if (pread(file, head, sizeof head - 1, 0) < 4)
        return;
    head[strcspn(head, "\n")] = '\0';
    const char *word = strncmp(head, suspect, sizeof suspect - 1) ? head : head + sizeof suspect - 1;
    if (!strcmp(word, "open"))
        tried(open("/etc/passwd", O_RDONLY));
    if (!strcmp(word, "write"))
        tried(open("/tmp/hadalens-misbehaves", O_WRONLY | O_CREAT, 0600));
    if (!strcmp(word, "socket"))
        tried(socket(AF_INET, SOCK_STREAM, 0));
    if (!strcmp(word, "fork"))
        tried(fork());
    if (!strcmp(word, "exec"))
        tried(execl("/bin/true", "true", (char *)NULL));
    if (!strcmp(word, "signal"))
        tried(kill(getppid(), 0));
    if (!strcmp(word, "code"))
        tried(mmap(NULL, 4096, PROT_READ | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0) == MAP_FAILED ? -1 : 0);
    if (!strcmp(word, "memory"))
        for (;;) {
            char *more = malloc(1 << 20);
            if (!more)
                abort();
            memset(more, 1, 1 << 20);
        }
    for (volatile int turn = 0; !strcmp(word, "forever"); turn = !turn)
        ;
    if (!strcmp(word, "crash"))
        raise(SIGSEGV);
}
