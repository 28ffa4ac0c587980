#include "core/library.h"

#include <dlfcn.h>
#include <pthread.h>

static pthread_mutex_t loading = PTHREAD_MUTEX_INITIALIZER;

static hada_status not_loaded(const hada_library *library, hada_error *err)
{
    const char *why = dlerror();
    return hada_fail(err, HADA_ERROR_UNSUPPORTED, "%s without %s; install it (Debian: %s): %s", library->purpose,
                     library->file, library->package, why ? why : "it is too old");
}

/* Under the lock. */
static hada_status load(hada_library *library, hada_error *err)
{
    void *const handle = dlopen(library->file, RTLD_NOW | RTLD_LOCAL);
    if (!handle)
        return not_loaded(library, err);
    for (size_t i = 0; i < library->count; i++) {
        void *const found = dlsym(handle, library->symbols[i].name);
        if (!found)
            return not_loaded(library, err);
        memcpy(library->symbols[i].place, &found, library->symbols[i].size);
    }
    library->loaded = 1;
    return HADA_OK;
}

hada_status hada_library_load(hada_library *library, hada_error *err)
{
    pthread_mutex_lock(&loading);
    const hada_status status = library->loaded ? HADA_OK : load(library, err);
    pthread_mutex_unlock(&loading);
    return status;
}
