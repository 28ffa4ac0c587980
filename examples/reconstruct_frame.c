/* The shortest program: one raw frame and a model in, the all-in-focus image and the distances out.
 *
 *   cc reconstruct_frame.c $(pkg-config --cflags --libs hadalens) -o reconstruct_frame
 *   ./reconstruct_frame camera.model frame.tif all-in-focus.tif */
#include <hadalens/hadalens.h>
#include <stdio.h>

int main(int argc, char **argv)
{
    hada_error err = {0};
    hada_context *context = NULL;
    hada_model *model = NULL;
    hada_plan *plan = NULL;
    hada_image raw = {0};
    hada_result result = {0};
    if (argc != 4) {
        fprintf(stderr, "usage: %s MODEL RAW.tif OUT.tif\n", argv[0]);
        return 2;
    }

    hada_status status = hada_context_create(&context, NULL, &err);
    if (!status)
        status = hada_model_load(&model, argv[1], &err);
    if (!status)
        status = hada_plan_create(&plan, context, model, NULL, &err);
    if (!status)
        status = hada_tiff_load(argv[2], 0, &raw, &err);
    if (!status)
        status = hada_plan_run(plan, &raw, &result, &err);
    if (!status)
        status = hada_tiff_save(argv[3], &result.all_in_focus, NULL, &err);

    if (status)
        fprintf(stderr, "%s\n", err.message);
    for (int z = 0; !status && z < result.depths; z++)
        if (result.report->occupied[z])
            printf("something stands at %g mm\n", result.distances_mm[z]);

    hada_result_destroy(&result);
    hada_image_destroy(&raw);
    hada_plan_destroy(&plan);
    hada_model_destroy(&model);
    hada_context_destroy(&context);
    return status ? 1 : 0;
}
