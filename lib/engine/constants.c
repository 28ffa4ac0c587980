/* The constants of a device: filters, transfer functions, the optics between depths. */
#include "engine/constants.h"

/* The largest share of a depth's PSF that its two neighbours may leave unexplained for the optics between depths to be
 * known; half way between depths the share is about a quarter (docs/explanation/surfaces.md).
 */
#define MOST_UNEXPLAINED 0.8

struct hada_surfaces {
    pthread_mutex_t lock;
    hada_magnification law; /* no depths: not measured yet */
    uint64_t each;          /* bytes of one */
    int made;
};

static hada_status surfaces_create(hada_surfaces **out, hada_error *err)
{
    HADA_TRY(HADA_NEW(*out, 1, "a plan", err));
    pthread_mutex_init(&(*out)->lock, NULL);
    return HADA_OK;
}

void hada_surfaces_destroy(hada_surfaces **pointer)
{
    if (!*pointer)
        return;
    hada_magnification_free(&(*pointer)->law);
    pthread_mutex_destroy(&(*pointer)->lock);
    free(*pointer);
    *pointer = NULL;
}

static hada_status check_law(const hada_magnification *law, hada_error *err)
{
    const double unexplained = law->unexplained[law->kind];
    if (unexplained < MOST_UNEXPLAINED)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_MODEL,
                     "neighbouring depths of this camera have too little in common for optics between them "
                     "(%.0f %% of a PSF stays unexplained): learn more depths, or take options.scene planes",
                     100 * unexplained);
}

static hada_status check_memory(const hada_context *context, const hada_surfaces_desc *desc, uint64_t bytes,
                                hada_error *err)
{
    if (bytes <= desc->most_bytes)
        return HADA_OK;
    return hada_fail(err, HADA_ERROR_DEVICE_MEMORY,
                     "a surface takes %.0f MiB of %s on each queue, and %.0f MiB are left for it: take fewer queues, "
                     "fewer depths (options.depths), or options.scene planes",
                     (double)bytes / 0x1p20, context->info.name, (double)desc->most_bytes / 0x1p20);
}

/* What measuring the law takes at most or, once it is known, a surface: *each, and at most while it is made. */
static hada_status count(const hada_context *context, const hada_surfaces_desc *desc, const hada_magnification *law,
                         uint64_t *each, uint64_t *most, hada_error *err)
{
    hada_dry dry;
    hada_surface *surface = NULL;
    hada_magnification unused;
    hada_dry_begin(&dry, context);
    const hada_status status =
        law->depths ? hada_surface_create(&surface, &dry.slot, &desc->camera, &desc->shape, law, err)
                    : hada_magnification_measure(&unused, &dry.slot, &desc->camera, desc->distances_mm, err);
    *each = hada_context_bytes(&dry.context);
    *most = hada_context_peak_bytes(&dry.context);
    hada_surface_destroy(&surface);
    hada_dry_end(&dry);
    return status;
}

/* With the lock held. */
static hada_status make(hada_surfaces *surfaces, hada_surface **out, hada_slot *slot, const hada_surfaces_desc *desc,
                        hada_error *err)
{
    uint64_t most;
    if (!surfaces->law.depths) {
        HADA_TRY(count(slot->context, desc, &surfaces->law, &surfaces->each, &most, err));
        HADA_TRY(check_memory(slot->context, desc, most, err));
        HADA_TRY(hada_magnification_measure(&surfaces->law, slot, &desc->camera, desc->distances_mm, err));
    }
    HADA_TRY(check_law(&surfaces->law, err));
    HADA_TRY(count(slot->context, desc, &surfaces->law, &surfaces->each, &most, err));
    HADA_TRY(check_memory(slot->context, desc, most, err));
    HADA_TRY(hada_surface_create(out, slot, &desc->camera, &desc->shape, &surfaces->law, err));
    surfaces->made++;
    return HADA_OK;
}

hada_status hada_surfaces_make(hada_surfaces *surfaces, hada_surface **out, hada_slot *slot,
                               const hada_surfaces_desc *desc, hada_error *err)
{
    pthread_mutex_lock(&surfaces->lock);
    const hada_status status = make(surfaces, out, slot, desc, err);
    pthread_mutex_unlock(&surfaces->lock);
    return status;
}

void hada_surfaces_unmake(hada_surfaces *surfaces, hada_surface **surface)
{
    if (!*surface)
        return;
    hada_surface_destroy(surface);
    pthread_mutex_lock(&surfaces->lock);
    surfaces->made--;
    pthread_mutex_unlock(&surfaces->lock);
}

uint64_t hada_surfaces_bytes(hada_surfaces *surfaces)
{
    pthread_mutex_lock(&surfaces->lock);
    const uint64_t bytes = (uint64_t)surfaces->made * surfaces->each;
    pthread_mutex_unlock(&surfaces->lock);
    return bytes;
}

static hada_status create_volumes(hada_volumes **out, hada_error *err)
{
    HADA_TRY(HADA_NEW(*out, 1, "a plan", err));
    pthread_mutex_init(&(*out)->lock, NULL);
    return HADA_OK;
}

static void destroy_volumes(hada_volumes **pointer)
{
    hada_volumes *volumes = hada_taken(pointer);
    if (!volumes)
        return;
    hada_buffer_destroy(&volumes->optics);
    hada_classic_camera_free(&volumes->camera);
    pthread_mutex_destroy(&volumes->lock);
    free(volumes);
}

void hada_volumes_unmake(hada_volumes *volumes, hada_classic **volume)
{
    if (!*volume)
        return;
    hada_classic_destroy(volume);
    pthread_mutex_lock(&volumes->lock);
    volumes->made--;
    pthread_mutex_unlock(&volumes->lock);
}

uint64_t hada_volumes_bytes(hada_volumes *volumes)
{
    pthread_mutex_lock(&volumes->lock);
    const uint64_t bytes = volumes->optics.bytes + (uint64_t)volumes->made * volumes->each;
    pthread_mutex_unlock(&volumes->lock);
    return bytes;
}

cl_mem hada_constants_otf(const hada_constants *constants, size_t *offset)
{
    size_t first;
    int together;
    *offset = 0;
    if (constants->optics.mem)
        return constants->optics.mem;
    const cl_mem otf = hada_bank_otf(constants->bank, 0, &first, &together);
    *offset = first * constants->bank->layout.count;
    return otf;
}

/* A classic method may have transfer functions of its own in place of the model's. */
static int has_optics(const hada_config *config)
{
    return config->classic && hada_classic_has_optics(&config->method);
}

static hada_status check_together(const hada_constants *constants, hada_error *err)
{
    size_t first;
    int together;
    hada_bank_otf(constants->bank, 0, &first, &together);
    if (together == constants->bank->depths)
        return HADA_OK;
    return hada_fail(
        err, HADA_ERROR_DEVICE_MEMORY,
        "planes that explain the frame jointly need the transfer functions of %d depths in one buffer, and "
        "%s takes %d: compute fewer depths (options.depths), or use linear filters (options.refine 0)",
        constants->bank->depths, constants->context->info.name, together);
}

hada_status hada_constants_create(hada_constants **out, hada_context *context, const hada_setup *setup, hada_error *err)
{
    const hada_config *config = &setup->config;
    const hada_model *model = setup->model;
    const hada_spectrum_layout layout = hada_hadamard_layout(context, hada_model_get_info(model));
    hada_constants *constants = NULL;
    hada_slot *slot = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(HADA_NEW(constants, 1, "a plan", err));
    constants->context = context;
    HADA_TRY_OR_DONE(surfaces_create(&constants->surfaces, err));
    HADA_TRY_OR_DONE(create_volumes(&constants->volumes, err));
    HADA_TRY_OR_DONE(hada_slot_create(&slot, context, err));
    HADA_TRY_OR_DONE(hada_bank_create(&constants->bank, slot, model, &layout, setup->depths, config->depths,
                                      has_optics(config) ? 0 : config->bank, config->half, err));
    if (has_optics(config))
        HADA_TRY_OR_DONE(hada_classic_optics(&constants->optics, context, &config->method, model, setup->depths,
                                             config->depths, err));
    else if (config->joint)
        HADA_TRY_OR_DONE(check_together(constants, err));
    if (config->joint && !config->classic)
        HADA_TRY_OR_DONE(hada_bank_prior(&constants->prior, slot, model, &layout, err));
    if (config->measured)
        HADA_TRY_OR_DONE(hada_gains_upload(&constants->gains, slot, setup->gains, &layout,
                                           hada_model_get_info(model)->channels, err));
    /* other queues read what this one wrote */
    HADA_TRY_OR_DONE(hada_slot_finish(slot, err));
done:
    hada_slot_destroy(&slot);
    if (status)
        hada_constants_destroy(&constants);
    *out = constants;
    return status;
}

void hada_constants_destroy(hada_constants **pointer)
{
    hada_constants *constants = hada_taken(pointer);
    if (!constants)
        return;
    HADA_DESTROY_BUFFERS(&constants->prior, &constants->gains, &constants->optics);
    hada_bank_destroy(&constants->bank);
    hada_surfaces_destroy(&constants->surfaces);
    destroy_volumes(&constants->volumes);
    free(constants);
}
