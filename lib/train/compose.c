#include "train/feed.h"

#include "core/base.h"
#include "core/random.h"

/* One sequence of random numbers for each purpose; those of augmentation end at 2 (train/feed.c). */
enum { COIN = 3, SCENE = 4 };

/* How often, in so many parts of a hundred: a picture on a surface (else objects side by side); the surface in stairs
 * from depth to depth (else it lies between them as well); the whole seen at once; objects of one picture (else of
 * several); three objects (else two); one of them dark; a depth too many told. Rough shares: no scene to be met is
 * known. */
enum { ON_SURFACE = 40, IN_STAIRS = 30, SEEN_WHOLE = 30, ONE_PICTURE = 50, THREE = 33, DARK = 25, ONE_TOO_MANY = 10 };

static int chance(hada_random *random, int percent)
{
    return hada_random_below(random, 100) < (uint32_t)percent;
}

static int between(hada_random *random, int low, int high)
{
    return high > low ? low + (int)hada_random_below(random, (uint32_t)(high - low + 1)) : low;
}

void hada_composed_free(hada_composed *composed)
{
    for (int i = 0; i < composed->count; i++)
        hada_image_destroy(&composed->light[i]);
    *composed = (hada_composed){0};
}

int hada_compose_variant(const hada_dataset *pairs, uint64_t seed, uint64_t place, double share)
{
    hada_random random;
    if (share <= 0.0)
        return 0;
    hada_random_seed(&random, seed, (uint64_t)COIN << 60 | place);
    if (hada_random_uniform(&random) >= share)
        return 0;
    return 1 + (int)(place / hada_pairs_total(pairs) % HADA_COMPOSED_VARIANTS);
}

/* Which of the scene's parts stands at each of the window's pixels: its number, and between two their blend, as light
 * from between two depths looks like light from both. */
typedef struct parts {
    int rows, cols, count;
    float *label;
} parts;

static float share_of(const parts *of, size_t pixel, int part)
{
    const float apart = fabsf(of->label[pixel] - (float)part);
    return apart < 1.0f ? 1.0f - apart : 0.0f;
}

/* A smooth height: a slope and random bumps, between a grid's points blended by 3t^2 - 2t^3. */
enum { BUMPS = 8 }; /* of the grid, along the longer side at most */
typedef struct landscape {
    double slope[2], high, cell;
    double bump[BUMPS + 2][BUMPS + 2];
} landscape;

static void draw_landscape(landscape *land, hada_random *random, int rows, int cols)
{
    const int longer = rows > cols ? rows : cols;
    land->cell = (double)longer / (double)between(random, 1, BUMPS);
    land->slope[0] = hada_random_range(random, -2.0, 2.0) / longer;
    land->slope[1] = hada_random_range(random, -2.0, 2.0) / longer;
    land->high = hada_random_uniform(random);
    for (int i = 0; i < BUMPS + 2; i++)
        for (int j = 0; j < BUMPS + 2; j++)
            land->bump[i][j] = hada_random_range(random, -1.0, 1.0);
}

static double height_at(const landscape *land, int row, int col)
{
    const double y = row / land->cell, x = col / land->cell;
    const int i = (int)y, j = (int)x;
    const double u = y - i, v = x - j, a = u * u * (3.0 - 2.0 * u), b = v * v * (3.0 - 2.0 * v);
    const double near = land->bump[i][j] * (1.0 - b) + land->bump[i][j + 1] * b,
                 far = land->bump[i + 1][j] * (1.0 - b) + land->bump[i + 1][j + 1] * b;
    return land->slope[0] * row + land->slope[1] * col + land->high * (near * (1.0 - a) + far * a);
}

/* A landscape from the first part to the last; in steps of the same height, or smooth. */
static void cut_landscape(parts *of, hada_random *random, int stairs)
{
    landscape land;
    double least = INFINITY, most = -INFINITY;
    draw_landscape(&land, random, of->rows, of->cols);
    for (int i = 0; i < of->rows * of->cols; i++) {
        const double height = height_at(&land, i / of->cols, i % of->cols);
        least = fmin(least, height);
        most = fmax(most, height);
    }
    for (int i = 0; i < of->rows * of->cols; i++) {
        const double share = (height_at(&land, i / of->cols, i % of->cols) - least) / (most - least + 1e-12);
        const int step = share < 1.0 ? (int)(share * of->count) : of->count - 1;
        of->label[i] = (float)(stairs ? step : share * (of->count - 1));
    }
}

/* Bars 4 pixels wide, up to a half of the window. */
static void cut_bars(parts *of, hada_random *random)
{
    const int shorter = of->rows < of->cols ? of->rows : of->cols;
    const double width = hada_random_range(random, 4.0, shorter > 8 ? shorter / 2.0 : 5.0);
    const double down = hada_random_range(random, -1.0, 1.0), right = hada_random_range(random, -1.0, 1.0),
                 length = sqrt(down * down + right * right) + 1e-12, start = hada_random_range(random, 0.0, width);
    for (int i = 0; i < of->rows * of->cols; i++) {
        const double along = (down * (i / of->cols) + right * (i % of->cols)) / length + start;
        of->label[i] = (float)(((long)floor(along / width) % of->count + of->count) % of->count);
    }
}

/* Round or oblong things before the first part. */
static void cut_discs(parts *of, hada_random *random)
{
    const int shorter = of->rows < of->cols ? of->rows : of->cols, discs = between(random, of->count - 1, 5);
    memset(of->label, 0, (size_t)of->rows * (size_t)of->cols * sizeof *of->label);
    for (int k = 0; k < discs; k++) {
        const double row = hada_random_range(random, 0.0, of->rows), col = hada_random_range(random, 0.0, of->cols),
                     high = hada_random_range(random, shorter / 16.0, shorter / 3.0),
                     wide = high * hada_random_range(random, 0.5, 2.0);
        for (int i = 0; i < of->rows * of->cols; i++) {
            const double y = (i / of->cols - row) / high, x = (i % of->cols - col) / wide;
            if (y * y + x * x < 1.0)
                of->label[i] = (float)(1 + k % (of->count - 1));
        }
    }
}

/* Which depths a scene has, ascending, and which part stands at each. */
typedef struct scene_plan {
    int count, depth[HADA_COMPOSED_DEPTHS], part[HADA_COMPOSED_DEPTHS];
    int surface;
    parts parts;
} scene_plan;

static void sort(scene_plan *plan)
{
    for (int i = 1; i < plan->count; i++)
        for (int k = i; k > 0 && plan->depth[k] < plan->depth[k - 1]; k--) {
            const int depth = plan->depth[k], part = plan->part[k];
            plan->depth[k] = plan->depth[k - 1];
            plan->part[k] = plan->part[k - 1];
            plan->depth[k - 1] = depth;
            plan->part[k - 1] = part;
        }
}

static int place_of(const scene_plan *plan, int depth)
{
    for (int i = 0; i < plan->count; i++)
        if (plan->depth[i] == depth)
            return i;
    return -1;
}

/* A surface through neighbouring depths, the pair's among them, up or down. */
static void plan_surface(scene_plan *plan, hada_random *random, int depths, int own)
{
    const int most = depths < HADA_COMPOSED_DEPTHS ? depths : HADA_COMPOSED_DEPTHS;
    const int count = between(random, 2, most), down = chance(random, 50);
    const int first =
        between(random, own - count + 1 > 0 ? own - count + 1 : 0, own + count <= depths ? own : depths - count);
    plan->surface = 1;
    plan->count = plan->parts.count = count;
    for (int i = 0; i < count; i++) {
        plan->depth[i] = first + i;
        plan->part[i] = down ? count - 1 - i : i;
    }
    cut_landscape(&plan->parts, random, chance(random, IN_STAIRS));
}

/* Objects at any depths. One of the parts may be dark: then its depth is not among them. */
static void plan_objects(scene_plan *plan, hada_random *random, int depths, int own)
{
    const int count = depths > 2 && chance(random, THREE) ? 3 : 2;
    const int shift = between(random, 0, count - 1), dark = chance(random, DARK);
    plan->parts.count = count;
    plan->count = 0;
    for (int i = 0; i < count - dark; i++) {
        int depth = own;
        while (i && place_of(plan, depth) >= 0)
            depth = between(random, 0, depths - 1);
        plan->depth[plan->count] = depth;
        plan->part[plan->count++] = (i + shift) % count;
    }
    sort(plan);
    switch (between(random, 0, 2)) {
    case 0: cut_landscape(&plan->parts, random, 1); break;
    case 1: cut_bars(&plan->parts, random); break;
    default: cut_discs(&plan->parts, random);
    }
}

/* A neighbour that is dark, as a search may find one too many. */
static void add_neighbour(scene_plan *plan, hada_random *random, int depths)
{
    const int near = plan->depth[between(random, 0, plan->count - 1)] + (chance(random, 50) ? 1 : -1);
    if (plan->count == HADA_COMPOSED_DEPTHS || near < 0 || near >= depths || place_of(plan, near) >= 0)
        return;
    plan->depth[plan->count] = near;
    plan->part[plan->count++] = -1;
    sort(plan);
}

static hada_status part_of(hada_image *out, const hada_image *picture, const parts *of, int part, hada_error *err)
{
    const size_t pixels = (size_t)of->rows * (size_t)of->cols, count = hada_image_count(picture);
    HADA_TRY(hada_image_create(out, picture->channels, picture->rows, picture->cols, err));
    for (size_t i = 0; i < count; i++)
        out->data[i] = share_of(of, i % pixels, part) * picture->data[i];
    return HADA_OK;
}

static hada_status read_other(hada_image *out, const hada_dataset *pairs, const hada_model_info *info,
                              hada_random *random, hada_error *err)
{
    const uint64_t total = hada_pairs_total(pairs);
    const uint32_t most = total < UINT32_MAX ? (uint32_t)total : UINT32_MAX;
    hada_image raw = {0};
    int depth, pair;
    hada_pairs_find(pairs, hada_random_below(random, most), &depth, &pair);
    const hada_status status = hada_pairs_read(pairs, info, depth, pair, &raw, out, err);
    hada_image_destroy(&raw);
    return status;
}

/* Lights of all depths but the pair's own. */
static hada_status light_others(hada_composed *out, const scene_plan *plan, const hada_dataset *pairs,
                                const hada_model_info *info, hada_random *random, int own, const hada_image *scene,
                                hada_error *err)
{
    const int one = plan->surface || chance(random, ONE_PICTURE);
    hada_image other = {0};
    hada_status status = HADA_OK;
    for (int i = 0; i < plan->count; i++) {
        if (plan->depth[i] == own || plan->part[i] < 0)
            continue;
        if (!one)
            HADA_TRY_OR_DONE(read_other(&other, pairs, info, random, err));
        HADA_TRY_OR_DONE(part_of(&out->light[i], one ? scene : &other, &plan->parts, plan->part[i], err));
        hada_image_destroy(&other);
    }
done:
    hada_image_destroy(&other);
    return status;
}

/* What is left of the pair's scene is the truth of its plane; what is not is taken away from the frame. Seen whole, the
 * truth is all that the scene holds now. */
static hada_status light_own(hada_composed *out, const scene_plan *plan, int own, hada_image *scene, hada_error *err)
{
    const int at = place_of(plan, own);
    const size_t count = hada_image_count(scene);
    hada_image rest = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(part_of(&rest, scene, &plan->parts, plan->part[at], err));
    HADA_TRY_OR_DONE(hada_image_create(&out->light[at], scene->channels, scene->rows, scene->cols, err));
    for (size_t i = 0; i < count; i++)
        out->light[at].data[i] = rest.data[i] - scene->data[i];
    for (int k = 0; out->whole && k < plan->count; k++)
        for (size_t i = 0; k != at && out->light[k].data && i < count; i++)
            rest.data[i] += out->light[k].data[i];
    hada_image_destroy(scene);
    *scene = rest;
    rest = (hada_image){0};
done:
    hada_image_destroy(&rest);
    return status;
}

hada_status hada_compose(hada_composed *out, const hada_dataset *pairs, const hada_model_info *info, uint64_t seed,
                         int depth, int pair, int variant, int planes_only, hada_image *scene, hada_error *err)
{
    scene_plan plan = {.parts = {.rows = scene->rows, .cols = scene->cols}};
    const uint64_t number = hada_pairs_number(pairs, depth, pair);
    hada_random random;
    hada_status status = HADA_OK;
    *out = (hada_composed){0};
    hada_random_seed(&random, seed,
                     (uint64_t)SCENE << 60 | (number * (HADA_COMPOSED_VARIANTS + 1) + (uint64_t)variant));
    HADA_TRY_OR_DONE(HADA_NEW(plan.parts.label, (size_t)scene->rows * (size_t)scene->cols, "a scene's parts", err));
    if (chance(&random, ON_SURFACE))
        plan_surface(&plan, &random, info->depths, depth);
    else
        plan_objects(&plan, &random, info->depths, depth);
    out->whole = chance(&random, SEEN_WHOLE) && !planes_only;
    if (chance(&random, ONE_TOO_MANY))
        add_neighbour(&plan, &random, info->depths);
    out->count = plan.count;
    memcpy(out->depth, plan.depth, sizeof out->depth);
    HADA_TRY_OR_DONE(light_others(out, &plan, pairs, info, &random, depth, scene, err));
    HADA_TRY_OR_DONE(light_own(out, &plan, depth, scene, err));
done:
    free(plan.parts.label);
    if (status)
        hada_composed_free(out);
    return status;
}
