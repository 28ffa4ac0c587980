/* Learns a camera from a folder of pairs and reconstructs frames with it: what 'hadalens fit CAMERA -o MODEL' and
 * 'hadalens reconstruct RAW.tif... -m MODEL -o FOLDER' do, with the same bits.
 *
 *   cc learn_and_reconstruct.c $(pkg-config --cflags --libs hadalens) -o learn_and_reconstruct
 *   ./learn_and_reconstruct CAMERA MODEL FOLDER RAW.tif... */
#include <hadalens/hadalens.h>
#include <stdio.h>

#define TRY(call)                                                                                                      \
    do {                                                                                                               \
        if ((status = (call)))                                                                                         \
            goto done;                                                                                                 \
    } while (0)

/* Of tasks that take long; a nonzero `cancelled` (none here) would stop them. */
static void on_progress(void *user, const char *what, long done, long total, const char *note)
{
    (void)user;
    (void)note;
    if (what && total)
        fprintf(stderr, "\r%ld of %ld %s ", done, total, what);
}

static void on_message(void *user, hada_message kind, const char *text)
{
    (void)user;
    if (kind == HADA_MESSAGE_NOTE)
        fprintf(stderr, "\nnote: %s\n", text);
}

/* What became of the files. */
static void on_file(void *user, const hada_files_state *state)
{
    (void)user;
    if (state->event == HADA_FILES_DONE)
        printf("%s: %s\n", state->path, state->outputs[HADA_OUTPUT_STACK]);
    if (state->event == HADA_FILES_FAILED)
        printf("%s\n", state->error->message);
}

int main(int argc, char **argv)
{
    hada_error err = {0};
    hada_status status;
    hada_monitor monitor;
    hada_fit_task learning;
    hada_files_task files;
    hada_context *context = NULL;
    hada_dataset *data = NULL;
    hada_model *model = NULL;
    hada_plan *plan = NULL;
    int failed = 0;
    if (argc < 5)
        return fprintf(stderr, "usage: %s CAMERA MODEL FOLDER RAW.tif...\n", argv[0]), 2;
    hada_monitor_init(&monitor);
    hada_fit_task_init(&learning);
    hada_files_task_init(&files);
    monitor.progress = on_progress;
    monitor.message = on_message;
    learning.monitor = files.monitor = &monitor;
    files.output = argv[3];
    files.tell = on_file;

    TRY(hada_context_create(&context, NULL, &err));
    TRY(hada_dataset_scan(&data, argv[1], NULL, &err));
    TRY(hada_fit_run(&model, NULL, context, data, &learning, &err));
    TRY(hada_model_save(model, argv[2], &err));
    TRY(hada_plan_create(&plan, context, model, NULL, &err));
    TRY(hada_reconstruct_files(plan, model, (const char *const *)argv + 4, argc - 4, &files, &failed, &err));
done:
    if (status)
        fprintf(stderr, "\n%s\n", err.message);
    hada_plan_destroy(&plan);
    hada_model_destroy(&model);
    hada_dataset_destroy(&data);
    hada_context_destroy(&context);
    return status || failed ? 1 : 0;
}
