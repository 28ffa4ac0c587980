/* Distance maps against the truth. */
#include "tasks/evaluate.h"

#include "io/folder.h"

/* The distances that the NAME_stack.tif beside a NAME_depth.tif (or another tail) states, freed with free(); 0 of them
 * where there is none, or one that cannot be read: then nothing is known. */
static hada_status distances_beside(double **out, int *count, const char *map_path, const char *tail_word,
                                    hada_error *err)
{
    hada_status status = HADA_OK;
    hada_tiff_reader *reader = NULL;
    hada_error ignored;
    hada_path path;
    const size_t stem = hada_stem_of(map_path), tail = strlen(tail_word);
    int there = 0;
    *out = NULL;
    *count = 0;
    if (!hada_stem_ends(map_path, stem, tail_word))
        return HADA_OK;
    HADA_TRY_OR_DONE(hada_path_write(path, err, "%.*s_stack%s", (int)(stem - tail), map_path, map_path + stem));
    HADA_TRY_OR_DONE(hada_path_finds_file(path, &there, err));
    if (!there || hada_tiff_open(&reader, path, &ignored))
        goto done;
    const hada_tiff_info *info = hada_tiff_get_info(reader);
    *count = info->distances;
    HADA_TRY_OR_DONE(HADA_NEW(*out, (size_t)*count + 1, "distances", err));
    for (int z = 0; z < *count; z++)
        (*out)[z] = info->distances_mm[z];
done:
    hada_tiff_close(&reader);
    return status;
}

/* The list that says what a depth step is. */
typedef struct steps {
    const double *distances;
    int count;
    double *own;
} steps;

static hada_status find_steps(steps *out, const hada_compared *open, const hada_evaluate_task *by, const char *tail,
                              hada_error *err)
{
    *out = (steps){by->distances_mm, by->distances, NULL};
    if (out->count)
        return HADA_OK;
    HADA_TRY(distances_beside(&out->own, &out->count, open->truth_path, tail, err));
    if (!out->count) {
        free(out->own);
        HADA_TRY(distances_beside(&out->own, &out->count, open->result_path, tail, err));
    }
    out->distances = out->own;
    return HADA_OK;
}

/* Page t of a file, thinned out and cut to the region; empty where there is no such page. */
static hada_status read_page(hada_image *out, const char *path, int t, int times, const hada_region *region,
                             hada_error *err)
{
    hada_tiff_reader *reader = NULL;
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(hada_tiff_open(&reader, path, err));
    if (t >= hada_tiff_get_info(reader)->frames)
        goto done;
    HADA_TRY_OR_DONE(hada_tiff_read(reader, t, out, err));
    HADA_TRY_OR_DONE(hada_compared_thin(out, times, err));
    HADA_TRY_OR_DONE(hada_region_cut(region, out, err));
done:
    hada_tiff_close(&reader);
    return status;
}

/* Page t of the image whose name has another tail, cut to the region; empty where there is no such file or page. */
static hada_status read_beside(hada_image *out, const char *path, const char *tail, const char *other, int t, int times,
                               const hada_region *region, hada_error *err)
{
    const size_t stem = hada_stem_of(path), length = strlen(tail);
    hada_path beside;
    int there = 0;
    *out = (hada_image){0};
    if (!hada_stem_ends(path, stem, tail))
        return HADA_OK;
    HADA_TRY(hada_path_write(beside, err, "%.*s%s%s", (int)(stem - length), path, other, path + stem));
    HADA_TRY(hada_path_finds_file(beside, &there, err));
    return there ? hada_named(read_page(out, beside, t, times, region, err), beside, err) : HADA_OK;
}

hada_status hada_evaluate_parts_beside(unsigned char **parts, const hada_compared *open, int t,
                                       const hada_compared_page *one, const hada_evaluate_task *by,
                                       const hada_region *region, hada_error *err)
{
    hada_image map = {0};
    steps list = {0};
    hada_status status = HADA_OK;
    *parts = NULL;
    HADA_TRY_OR_DONE(find_steps(&list, open, by, "_aif", err));
    if (list.count < 2)
        goto done;
    HADA_TRY_OR_DONE(read_beside(&map, open->truth_path, "_aif", "_depth", t, open->times, region, err));
    if (!map.data || map.channels != 1 || map.rows != one->truth.rows || map.cols != one->truth.cols)
        goto done;
    HADA_TRY_OR_DONE(HADA_NEW(*parts, hada_image_count(&map), "parts of a map", err));
    HADA_TRY_OR_DONE(hada_metric_depth_parts(&map, list.distances, list.count, HADA_AUTO, HADA_AUTO, *parts, err));
done:
    free(list.own);
    hada_image_destroy(&map);
    return status;
}

/* Sums over the frames of a sequence, weighted by their pixels. */
typedef struct depth_sums {
    double covered, pixels, within, error, steps;
} depth_sums;

static void add_score(depth_sums *sums, const hada_depth_score *depth, int steps_known)
{
    const double here = depth->coverage * (double)depth->pixels;
    sums->pixels += (double)depth->pixels;
    sums->covered += here;
    if (here > 0) {
        sums->within += depth->within * here;
        sums->error += depth->mean_error_mm * here;
        sums->steps += steps_known ? depth->mean_steps * here : 0;
    }
}

/* What is summed for maps; the first is all but what lies outside. */
enum { ALL, JUMPS, AWAY, PLACES };

typedef struct map_sums {
    depth_sums place[PLACES];
    double outside, unknown, half, risk, claimed;
    const hada_evaluate_task *by;
    steps list;
    int steps_known;
} map_sums;

/* 1 where a pixel counts for a place; returns how many do. `parts` NULL: all with a true distance. */
static size_t choose(const hada_compared_page *one, const unsigned char *parts, int place, unsigned char *chosen)
{
    size_t count = 0;
    for (size_t i = 0; i < hada_image_count(&one->truth); i++) {
        const int part = parts ? parts[i] : isnan(one->truth.data[i]) ? HADA_DEPTH_NONE : HADA_DEPTH_AWAY;
        chosen[i] =
            hada_compared_counts(one, i) && (place == JUMPS  ? part == HADA_DEPTH_JUMP
                                             : place == AWAY ? part == HADA_DEPTH_AWAY
                                                             : part == HADA_DEPTH_JUMP || part == HADA_DEPTH_AWAY);
        count += chosen[i];
    }
    return count;
}

static void add_outside(map_sums *sums, const hada_compared_page *one, const unsigned char *parts)
{
    for (size_t i = 0; i < hada_image_count(&one->truth); i++)
        if (hada_compared_counts(one, i) && parts[i] == HADA_DEPTH_OUTSIDE) {
            sums->outside++;
            sums->unknown += isnan(one->result.data[i]) != 0;
        }
}

static hada_status add_confidence(map_sums *sums, const hada_compared *open, int t, const hada_compared_page *one,
                                  const hada_region *region, const unsigned char *chosen, hada_error *err)
{
    hada_confidence_score score = {.size = sizeof score};
    hada_image confidence = {0};
    hada_status status = HADA_OK;
    HADA_TRY_OR_DONE(read_beside(&confidence, open->result_path, "_depth", "_confidence", t, 1, region, err));
    if (!confidence.data)
        goto done;
    HADA_TRY_OR_DONE(hada_metric_depth_confidence(&one->result, &one->truth, &confidence,
                                                  sums->steps_known ? sums->list.distances : NULL,
                                                  sums->steps_known ? sums->list.count : 0, chosen, &score, err));
    if (score.pixels) {
        sums->half += score.half_error * (double)score.pixels;
        sums->risk += score.risk * (double)score.pixels;
        sums->claimed += (double)score.pixels;
    }
done:
    hada_image_destroy(&confidence);
    return status;
}

static hada_status add_page(map_sums *sums, const hada_compared *open, int t, hada_compared_page *one,
                            const hada_region *region, hada_error *err)
{
    const double *distances = sums->steps_known ? sums->list.distances : NULL;
    const int count = sums->steps_known ? sums->list.count : 0;
    const size_t pixels = hada_image_count(&one->truth);
    unsigned char *parts = NULL, *chosen = NULL;
    hada_image second = {0};
    hada_status status = HADA_OK;
    if (!one->result.data || one->truth.channels != 1)
        return hada_fail(err, HADA_ERROR_SIZE, "%s has no distance map for page %d of %s", open->result_path, t + 1,
                         open->truth_path);
    HADA_TRY_OR_DONE(HADA_NEW(chosen, pixels, "a mask", err));
    if (sums->steps_known) {
        HADA_TRY_OR_DONE(HADA_NEW(parts, pixels, "parts of a map", err));
        HADA_TRY_OR_DONE(hada_metric_depth_parts(&one->truth, distances, count, HADA_AUTO, HADA_AUTO, parts, err));
        add_outside(sums, one, parts);
    }
    HADA_TRY_OR_DONE(read_beside(&second, open->truth_path, "_depth", "_depth2", t, open->times, region, err));
    if (second.data)
        HADA_TRY_OR_DONE(hada_metric_depth_nearer(&one->truth, &second, &one->result, distances, count, err));
    for (int place = PLACES - 1; place >= ALL; place--) { /* so that `chosen` is all in the end */
        hada_depth_score depth = {.size = sizeof depth};
        const size_t here = choose(one, parts, place, chosen);
        if (!here && (place != ALL || sums->outside > 0))
            continue;
        HADA_TRY_OR_DONE(
            hada_metric_depth(&one->result, &one->truth, distances, count, sums->by->tolerance, chosen, &depth, err));
        add_score(&sums->place[place], &depth, sums->steps_known);
    }
    HADA_TRY_OR_DONE(add_confidence(sums, open, t, one, region, chosen, err));
done:
    HADA_FREE(parts, chosen);
    hada_image_destroy(&second);
    return status;
}

static void give(const map_sums *sums, hada_evaluation *score)
{
    const depth_sums *all = &sums->place[ALL], *jumps = &sums->place[JUMPS], *away = &sums->place[AWAY];
    score->depth = (hada_depth_score){.size = sizeof score->depth,
                                      .pixels = (long long)all->pixels,
                                      .coverage = all->covered / all->pixels,
                                      .within = all->within / all->covered,
                                      .mean_error_mm = all->error / all->covered,
                                      .mean_steps = sums->steps_known ? all->steps / all->covered : (double)NAN};
    score->confident_half = sums->half / sums->claimed;
    score->risk = sums->risk / sums->claimed;
    if (!sums->steps_known)
        return;
    score->steps_jumps = jumps->steps / jumps->covered;
    score->within_jumps = jumps->within / jumps->covered;
    score->coverage_jumps = jumps->covered / jumps->pixels;
    score->steps_away = away->steps / away->covered;
    score->within_away = away->within / away->covered;
    score->coverage_away = away->covered / away->pixels;
    score->outside = sums->outside / (sums->outside + all->pixels);
    score->outside_unknown = sums->unknown / sums->outside;
}

hada_status hada_evaluate_maps(hada_evaluation *score, const hada_compared *open, const hada_evaluate_task *by,
                               const hada_region *region, hada_error *err)
{
    hada_status status = HADA_OK;
    map_sums sums = {.by = by};
    hada_compared_page one = {0};
    HADA_TRY_OR_DONE(find_steps(&sums.list, open, by, "_depth", err));
    sums.steps_known = score->steps_known = sums.list.count >= 2;
    for (int t = 0; t < open->count; t++) {
        HADA_TRY_OR_DONE(hada_compared_read(&one, open, t, 1, region, err));
        HADA_TRY_OR_DONE(add_page(&sums, open, t, &one, region, err));
        score->pages++;
        hada_compared_page_free(&one);
    }
    give(&sums, score);
done:
    hada_compared_page_free(&one);
    free(sums.list.own);
    return status;
}
