/* Contexts, queues and buffers of a program of its own. */
#include <hadalens/opencl.h>

#include "learned_camera.h"

typedef struct outside {
    cl_context context;
    cl_device_id device;
    cl_command_queue queue;
    hada_context *adopted;
} outside;

/* A program's own context on the device of the tests. */
static outside open_outside(const learned_camera *learned)
{
    outside o;
    cl_int code;
    o.device = hada_context_cl_device(learned->context);
    o.context = clCreateContext(NULL, 1, &o.device, NULL, NULL, &code);
    assert_int_equal(code, CL_SUCCESS);
    o.queue = clCreateCommandQueue(o.context, o.device, 0, &code);
    assert_int_equal(code, CL_SUCCESS);
    ASSERT_OK(hada_context_adopt(&o.adopted, o.context, o.device, NULL, err));
    assert_ptr_equal(hada_context_cl_context(o.adopted), o.context);
    assert_ptr_equal(hada_context_cl_device(o.adopted), o.device);
    assert_string_equal(hada_context_device(o.adopted)->name, hada_context_device(learned->context)->name);
    return o;
}

static void close_outside(outside *o)
{
    hada_context_destroy(&o->adopted);
    clReleaseCommandQueue(o->queue);
    clReleaseContext(o->context);
}

static cl_mem buffer_of(const outside *o, size_t bytes)
{
    cl_int code;
    const cl_mem mem = clCreateBuffer(o->context, CL_MEM_READ_WRITE, bytes, NULL, &code);
    assert_int_equal(code, CL_SUCCESS);
    return mem;
}

static void expect_floats(const outside *o, cl_mem mem, size_t offset, const float *expected, size_t count)
{
    SCOPED_MEMORY float *values = malloc(count * sizeof *values);
    assert_int_equal(clEnqueueReadBuffer(o->queue, mem, CL_TRUE, offset, count * sizeof *values, values, 0, NULL, NULL),
                     CL_SUCCESS);
    assert_memory_equal(values, expected, count * sizeof *values);
}

enum { FRAME_OFFSET = 64, STACK_OFFSET = 128 };

/* Linear, refined, one depth listed alone, and nothing found: the bits of the way over the host. */
TEST(frames_and_results_stay_on_the_device)
{
    const learned_camera *learned = *state;
    const hada_model_info *info = hada_model_get_info(learned->model);
    const size_t map = (size_t)info->window_rows * (size_t)info->window_cols, plane = map * (size_t)info->channels;
    const size_t stack = plane * (size_t)info->depths;
    static const int list[] = {1};
    outside o = open_outside(learned);
    SCOPED(hada_image) scene = learned_scene(learned, 42);
    SCOPED(hada_image) raw = learned_frame(learned, &(hada_plane){1, &scene}, 1, 42);
    const size_t bytes = hada_image_count(&raw) * sizeof(float);
    cl_mem pixels = buffer_of(&o, FRAME_OFFSET + bytes);
    DEFAULTS(hada_cl_frame, frame);
    DEFAULTS(hada_cl_arrays, arrays);
    frame.pixels = pixels;
    frame.offset = FRAME_OFFSET;
    frame.queue = o.queue;
    arrays.stack = buffer_of(&o, STACK_OFFSET + stack * sizeof(float));
    arrays.stack_offset = STACK_OFFSET;
    arrays.all_in_focus = buffer_of(&o, plane * sizeof(float));
    arrays.distance_map = buffer_of(&o, map * sizeof(float));
    for (int kind = 0; kind < 4; kind++) {
        SCOPED(hada_plan) * plan;
        SCOPED(hada_result) host = {0}, device = {0};
        DEFAULTS(hada_plan_options, options);
        options.refine = kind == 1 || kind == 3 ? 3 : 0;
        options.occupied = kind == 2 ? HADA_OCCUPIED_LIST : HADA_OCCUPIED_AUTO;
        options.occupied_list = kind == 2 ? list : NULL;
        options.occupied_count = kind == 2;
        if (kind == 3)
            memset(raw.data, 0, bytes); /* darkness */
        ASSERT_OK(hada_plan_create(&plan, o.adopted, learned->model, &options, err));
        ASSERT_OK(hada_plan_run(plan, &raw, &host, err));
        /* enqueued, and not waited for here */
        assert_int_equal(clEnqueueWriteBuffer(o.queue, pixels, CL_FALSE, FRAME_OFFSET, bytes, raw.data, 0, NULL, NULL),
                         CL_SUCCESS);
        ASSERT_OK(hada_result_use_cl(&device, &arrays, err));
        if (kind == 2) {
            SCOPED(hada_job) * job;
            ASSERT_OK(hada_job_submit_cl(&job, plan, &frame, &device, err));
            ASSERT_OK(hada_job_wait(job, err));
        } else
            ASSERT_OK(hada_plan_run_cl(plan, &frame, &device, err));
        expect_floats(&o, arrays.stack, STACK_OFFSET, host.planes[0].data, stack);
        expect_floats(&o, arrays.all_in_focus, 0, host.all_in_focus.data, plane);
        expect_floats(&o, arrays.distance_map, 0, host.distance_map.data, map);
        assert_memory_equal(device.planes[0].data, host.planes[0].data, stack * sizeof(float));
        cl_command_queue queue = hada_plan_cl_queue(plan, 0);
        assert_non_null(queue);
        assert_int_equal(clFinish(queue), CL_SUCCESS);
        assert_null(hada_plan_cl_queue(plan, 1));
    }
    clReleaseMemObject(pixels);
    clReleaseMemObject(arrays.stack);
    clReleaseMemObject(arrays.all_in_focus);
    clReleaseMemObject(arrays.distance_map);
    close_outside(&o);
}

TEST(what_does_not_fit_is_refused)
{
    const learned_camera *learned = *state;
    outside o = open_outside(learned);
    hada_plan *plan, *elsewhere, *bright;
    hada_result result = {0};
    hada_context *context;
    const hada_model_info *info = hada_model_get_info(learned->model);
    const size_t bytes = (size_t)info->channels * (size_t)info->raw_rows * (size_t)info->raw_cols * sizeof(float);
    DEFAULTS(hada_plan_options, options);
    ASSERT_OK(hada_plan_create(&plan, o.adopted, learned->model, &options, err));
    ASSERT_OK(hada_plan_create(&elsewhere, learned->context, learned->model, &options, err));
    options.gamma = 0.5;
    ASSERT_OK(hada_plan_create(&bright, o.adopted, learned->model, &options, err));
    DEFAULTS(hada_cl_frame, frame);
    ASSERT_FAILS(hada_plan_run_cl(plan, &frame, &result, err), HADA_ERROR_ARGUMENT, "");
    frame.pixels = buffer_of(&o, bytes);
    frame.offset = 4;
    ASSERT_FAILS(hada_plan_run_cl(plan, &frame, &result, err), HADA_ERROR_SIZE, "");
    frame.offset = 0;
    ASSERT_FAILS(hada_plan_run_cl(elsewhere, &frame, &result, err), HADA_ERROR_ARGUMENT, "hada_context_adopt");
    DEFAULTS(hada_cl_arrays, arrays);
    arrays.distance_map = buffer_of(&o, 16);
    ASSERT_OK(hada_result_use_cl(&result, &arrays, err));
    ASSERT_FAILS(hada_plan_run_cl(bright, &frame, &result, err), HADA_ERROR_UNSUPPORTED, "");
    ASSERT_FAILS(hada_plan_run_cl(plan, &frame, &result, err), HADA_ERROR_SIZE, "distance map");
    ASSERT_FAILS(hada_context_adopt(&context, o.context, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
    clReleaseMemObject(frame.pixels);
    clReleaseMemObject(arrays.distance_map);
    hada_result_destroy(&result);
    hada_plan_destroy(&plan);
    hada_plan_destroy(&elsewhere);
    hada_plan_destroy(&bright);
    close_outside(&o);
}

FIXTURE(learned_setup, learned_teardown)
