/* Refinement that stops when its planes have settled. */
#include "refine_fixture.h"

/* How much the planes of two depths change from so many steps to four more, of what they are then. */
static double change(fixture *f, hada_refine_rule rule, int steps)
{
    const size_t count = (size_t)(2 * f->camera.channels) * f->camera.window_area;
    double of_change = 0.0, of_planes = 0.0;
    float *planes[2];
    rule.settle = 0.0;
    for (int i = 0; i < 2; i++) {
        rule.steps = steps + 4 * i;
        ASSERT_OK(hada_refiner_run(f->refiner, &f->device.data, &rule, 1, 2, (const int[]){1, 2}, NULL, err));
        planes[i] = read_planes(f, 2);
    }
    for (size_t k = 0; k < count; k++) {
        of_change += pow((double)planes[1][k] - planes[0][k], 2);
        of_planes += pow(planes[1][k], 2);
    }
    HADA_FREE(planes[0], planes[1]);
    return sqrt(of_change / of_planes);
}

/* Neighbours part slowly: steps go on until four of them change little, and not beyond. */
TEST(goes_on_until_depths_have_parted)
{
    for (int padded = 0; padded < 2; padded++) {
        fixture f;
        int steps, all;
        set_up(&f, 48, 64, 20, 24, 4, 2, padded);
        two_depths(&f, 1, 2);
        expose(&f, 0.01, 1.0);
        DEFAULTS(hada_refine_rule, rule);
        rule.tv = 1e-3;
        rule.steps = 40;
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, (const int[]){1, 2}, &all, err));
        assert_int_equal(all, 40);
        rule.settle = 0.5 * (change(&f, rule, 16) + change(&f, rule, 20));
        ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, (const int[]){1, 2}, &steps, err));
        assert_int_equal(steps, 24);
        assert_true(change(&f, rule, 12) >= rule.settle && change(&f, rule, 20) < rule.settle);
        tear_down(&f);
    }
}

/* Devices with memory of their own are asked less often, about two looks at once: the planes are the same. */
TEST(asks_less_often_where_that_is_dear)
{
    static const int at[] = {12, 16, 20, 24};
    for (size_t k = 0; k < HADA_COUNT(at); k++) {
        float *planes[2];
        size_t bytes = 0;
        for (int apart = 0; apart < 2; apart++) {
            fixture f;
            int steps;
            set_up(&f, 48, 64, 20, 24, 4, 2, 0);
            f.device.context->info.unified_memory = !apart;
            hada_refiner_destroy(&f.refiner);
            ASSERT_OK(hada_refiner_create(&f.refiner, f.device.slot, &f.device.shape, err));
            two_depths(&f, 1, 2);
            expose(&f, 0.01, 1.0);
            DEFAULTS(hada_refine_rule, rule);
            rule.tv = 1e-3;
            rule.steps = 40;
            rule.settle = at[k] == 12 ? 2.0 * change(&f, rule, 8)
                                      : 0.5 * (change(&f, rule, at[k] - 8) + change(&f, rule, at[k] - 4));
            ASSERT_OK(hada_refiner_run(f.refiner, &f.device.data, &rule, 1, 2, (const int[]){1, 2}, &steps, err));
            assert_int_equal(steps, at[k]);
            planes[apart] = read_planes(&f, 2);
            bytes = (size_t)(2 * f.camera.channels) * f.camera.window_area * sizeof(float);
            tear_down(&f);
        }
        assert_memory_equal(planes[0], planes[1], bytes);
        HADA_FREE(planes[0], planes[1]);
    }
}
