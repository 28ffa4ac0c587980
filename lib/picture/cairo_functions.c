#include "picture/cairo_functions.h"

#include <dlfcn.h>
#include <pthread.h>
#include <string.h>

#ifdef __APPLE__
#define CAIRO_FILE "libcairo.2.dylib"
#else
#define CAIRO_FILE "libcairo.so.2"
#endif

static pthread_mutex_t loading = PTHREAD_MUTEX_INITIALIZER;
hada_cairo hada_cairo_api;
static int loaded; /* guarded by `loading` */

static hada_status not_loaded(hada_error *err)
{
    const char *why = dlerror();
    return hada_fail(err, HADA_ERROR_UNSUPPORTED,
                     "no pictures can be drawn: cairo is not there; install it (Debian: libcairo2): %s",
                     why ? why : "it is too old");
}

static hada_status find(void *library, const char *name, void *pointer, size_t size, hada_error *err)
{
    void *const found = dlsym(library, name);
    if (!found)
        return not_loaded(err);
    memcpy(pointer, &found, size);
    return HADA_OK;
}

/* Under the lock. */
static hada_status load(hada_error *err)
{
    void *const library = dlopen(CAIRO_FILE, RTLD_NOW | RTLD_LOCAL);
    if (!library)
        return not_loaded(err);
#define FIND(name) HADA_TRY(find(library, "cairo_" #name, &hada_cairo_api.name, sizeof hada_cairo_api.name, err));
    HADA_CAIRO_FUNCTIONS(FIND)
#undef FIND
    loaded = 1; /* and never closed: cairo keeps fonts until the process ends */
    return HADA_OK;
}

hada_status hada_cairo_load(hada_error *err)
{
    pthread_mutex_lock(&loading);
    const hada_status status = loaded ? HADA_OK : load(err);
    pthread_mutex_unlock(&loading);
    return status;
}
