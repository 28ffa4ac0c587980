#include <hadalens/hadalens.h>
#include <stdio.h>

int main(void)
{
    hada_context *context;
    hada_error error;
    if (hada_context_create(&context, NULL, &error)) {
        fprintf(stderr, "%s\n", error.message);
        return 1;
    }
    printf("%s\n", hada_context_device(context)->name);
    hada_context_destroy(&context);
    return 0;
}
