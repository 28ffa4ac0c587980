#include "optics/occlusion.h"

#define LEAST 1e-9 /* of the brightest pixel: there is no ray where there is less */

/* The light of a patch, blurred, on the screen. Patches at the edge of the lattice take what is beyond it. */
static hada_status trace(hada_patch_light *light, int patch, hada_error *err)
{
    const hada_lenses *p = light->patches;
    const double half = p->design.camera.aperture_mm / 2.0, centre[2] = {p->x[patch], p->y[patch]};
    double low[2], high[2], all;
    for (int k = 0; k < 2; k++) {
        const int i = (int)lrint((centre[k] + half) / p->side - 0.5);
        low[k] = i > 0 ? i * p->side - half : -HUGE_VAL;
        high[k] = i < p->across - 1 ? (i + 1) * p->side - half : HUGE_VAL;
    }
    hada_rays_clear(&light->rays);
    HADA_TRY(hada_rays_trace(&light->rays, low, high, &all, err));
    hada_rays_blur(&light->rays);
    return HADA_OK;
}

/* The pixels of the image where the screen holds light. */
static void box(const hada_patch_light *light, int first[2], int end[2])
{
    const hada_rays *r = &light->rays;
    first[0] = (int)fmax(0.0, r->top - r->margin);
    first[1] = (int)fmax(0.0, r->left - r->margin);
    end[0] = (int)fmin(light->rows, r->bottom - r->margin);
    end[1] = (int)fmin(light->cols, r->right - r->margin);
}

hada_status hada_patch_light_make(hada_patch_light *light, const hada_lenses *patches, double distance_mm, int rows,
                                  int cols, double axis_row, double axis_col, hada_error *err)
{
    *light = (hada_patch_light){.patches = patches, .rows = rows, .cols = cols};
    HADA_TRY(hada_rays_make(&light->rays, &patches->design, distance_mm, rows, cols, axis_row, axis_col, err));
    HADA_TRY(HADA_NEW(light->all, (size_t)rows * (size_t)cols, "the light of patches", err));
    for (int p = 0; p < patches->count; p++) {
        int first[2], end[2];
        HADA_TRY(trace(light, p, err));
        box(light, first, end);
        for (int r = first[0]; r < end[0]; r++)
            for (int c = first[1]; c < end[1]; c++) {
                double *sum = &light->all[(size_t)r * (size_t)cols + (size_t)c];
                *sum += hada_rays_at(&light->rays, r, c);
                light->least = fmax(light->least, LEAST * *sum);
            }
    }
    return HADA_OK;
}

void hada_patch_light_free(hada_patch_light *light)
{
    hada_rays_free(&light->rays);
    free(light->all);
    *light = (hada_patch_light){0};
}

hada_status hada_patch_light_share(hada_patch_light *light, int patch, const int *labels, float *share, hada_error *err)
{
    int first[2], end[2];
    HADA_TRY(trace(light, patch, err));
    box(light, first, end);
    for (int r = 0; r < light->rows; r++)
        for (int c = 0; c < light->cols; c++) {
            const size_t at = (size_t)r * (size_t)light->cols + (size_t)c;
            const int inside = r >= first[0] && r < end[0] && c >= first[1] && c < end[1];
            if (light->all[at] > light->least)
                share[at] = inside ? (float)(hada_rays_at(&light->rays, r, c) / light->all[at]) : 0.0f;
            else
                share[at] = (float)(labels[at] == patch);
        }
    return HADA_OK;
}
