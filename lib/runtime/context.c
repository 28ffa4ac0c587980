/* The log, the device and the memory count of a context. */
#include "runtime/context.h"

#include <stdarg.h>

void hada_log(const hada_context *context, hada_log_level level, const char *format, ...)
{
    if (!context->log || level > context->log_level)
        return;
    char message[1024];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    context->log(context->log_user, level, message);
}

const hada_device_info *hada_context_device(const hada_context *context)
{
    return context ? &context->info : NULL;
}

static uint64_t locked(const hada_context *context, const uint64_t *value)
{
    pthread_mutex_t *lock = &((hada_context *)context)->lock;
    pthread_mutex_lock(lock);
    uint64_t copy = *value;
    pthread_mutex_unlock(lock);
    return copy;
}

uint64_t hada_context_bytes(const hada_context *context)
{
    return locked(context, &context->bytes);
}

uint64_t hada_context_peak_bytes(const hada_context *context)
{
    return locked(context, &context->peak_bytes);
}

void hada_context_reset_peak(hada_context *context)
{
    if (!context)
        return;
    pthread_mutex_lock(&context->lock);
    context->peak_bytes = context->bytes;
    pthread_mutex_unlock(&context->lock);
}
