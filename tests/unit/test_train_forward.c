/* What replicas give forward: the bits of reconstruction; and what they refuse. */
#include "net/enhance.h"
#include "train_run.h"

/* What reconstruction makes of the same plane, bit for bit, also after the weights were changed. */
TEST(forward_is_the_enhancement)
{
    static const int which[] = {0, 1, 2, 6};
    net_device *device = *state;
    for (size_t i = 0; i < HADA_COUNT(which); i++) {
        replica_run run;
        hada_terms terms;
        SCOPED(hada_image) before = {0}, after = {0};
        run_make(&run, &train_cases[which[i]]);
        hada_replica *replica = train_replica(device, &run.desc);
        hada_parameters_clear(hada_replica_parameters(replica));
        ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0, 1, 0, &terms, NULL, err));
        ASSERT_OK(hada_parameters_update(hada_replica_parameters(replica), HADA_GROUP_NET, 1, 1e-3, 1.0, err));
        hada_image *input = &run.pairs.input[0];
        ASSERT_OK(hada_replica_forward(replica, &run.pairs.samples[0], &before, &after, err));
        assert_memory_equal(before.data, input->data, hada_image_count(input) * sizeof(float));
        ASSERT_OK(hada_parameters_read(hada_replica_parameters(replica), HADA_GROUP_NET, HADA_CONTENT_VALUES,
                                       run.net->values, err));
        const hada_enhance_desc desc = {.net = run.net,
                                        .channels = train_cases[which[i]].channels,
                                        .rows = WINDOW_ROWS,
                                        .cols = WINDOW_COLS,
                                        .net_rows = run.options.net_rows,
                                        .net_cols = run.options.net_cols};
        hada_enhance *enhance;
        hada_buffer buffer;
        const size_t bytes = hada_image_count(input) * sizeof(float);
        ASSERT_OK(hada_enhance_create(&enhance, device->slot, &desc, err));
        ASSERT_OK(hada_buffer_create_from(&buffer, device->slot, input->data, bytes, "a plane", err));
        ASSERT_OK(hada_enhance_run(enhance, buffer.mem, 0, 1, 1, err));
        ASSERT_OK(hada_buffer_read(&buffer, device->slot, 0, before.data, bytes, err));
        assert_memory_equal(before.data, after.data, bytes);
        memset(input->data, 0, bytes);
        ASSERT_OK(hada_replica_forward(replica, &run.pairs.samples[0], NULL, &after, err));
        assert_memory_equal(input->data, after.data, bytes);
        hada_enhance_destroy(&enhance);
        hada_buffer_destroy(&buffer);
        hada_replica_destroy(&replica);
        run_free(&run);
    }
}

/* Dropout draws by the step, and nothing is dropped where the net is only looked at. */
TEST(dropout_follows_the_step)
{
    static const char text[] = "{\"format\": \"hadalens-net-1\", \"layers\": [{\"layer\": \"input\", \"channels\": 2},"
                               "{\"layer\": \"conv\", \"name\": \"a\", \"channels\": 8, \"activation\": \"relu\"},"
                               "{\"layer\": \"dropout\", \"p\": 0.5},"
                               "{\"layer\": \"conv\", \"name\": \"b\", \"channels\": 2}]}";
    replica_run run;
    hada_terms terms[3];
    SCOPED(hada_image) first = {0}, second = {0};
    run_make(&run, &train_cases[0]);
    hada_net_destroy(&run.net);
    run.desc.net = run.net = net_from(text, 6);
    hada_replica *replica = train_replica(*state, &run.desc);
    ASSERT_OK(hada_replica_forward(replica, &run.pairs.samples[0], NULL, &first, err));
    for (int i = 0; i < 3; i++)
        ASSERT_OK(hada_replica_backward(replica, run.pairs.samples, TRAIN_PAIRS, 1.0, i == 1 ? 8 : 7, 0, &terms[i],
                                        NULL, err));
    ASSERT_OK(hada_replica_forward(replica, &run.pairs.samples[0], NULL, &second, err));
    assert_true(terms[0].mse == terms[2].mse && terms[0].mse != terms[1].mse);
    assert_memory_equal(first.data, second.data, hada_image_count(&first) * sizeof(float));
    hada_replica_destroy(&replica);
    run_free(&run);
}

FIXTURE(net_device_open, net_device_close)
