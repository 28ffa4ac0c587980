/* Preloaded, a machine without cairo: loading it fails. */
#include <dlfcn.h>
#include <string.h>

__attribute__((visibility("default"))) void *dlopen(const char *file, int mode);

void *dlopen(const char *file, int mode)
{
    void *(*next)(const char *, int) = NULL;
    void *const found = dlsym(RTLD_NEXT, "dlopen");
    memcpy(&next, &found, sizeof next);
    return file && strstr(file, "cairo") ? NULL : next(file, mode);
}
