/* Data sets: what a folder holds, which files belong together, what is refused and in which words, and the two parts
 * to learn from and to hold out. No device. */
#include <tiffio.h>

#include "dataset/dataset.h"
#include "image/mosaic.h"
#include "testing.h"

static char root[200], set[240];

static const char *at(const char *name)
{
    return path_below(set, name);
}

/* A picture of one value, with the folders above it. */
static void put(const char *name, float value)
{
    char folder[400];
    SCOPED(hada_image) image;
    snprintf(folder, sizeof folder, "%s", at(name));
    *strrchr(folder, '/') = '\0';
    ASSERT_OK(hada_folder_ensure(folder, err));
    ASSERT_OK(hada_image_create(&image, 1, 2, 3, err));
    for (size_t i = 0; i < 6; i++)
        image.data[i] = value;
    ASSERT_OK(hada_tiff_save(at(name), &image, NULL, err));
}

static void put_pair(const char *depth, const char *name, float value)
{
    char path[100];
    snprintf(path, sizeof path, "%s/raw/%s.tif", depth, name);
    put(path, value);
    snprintf(path, sizeof path, "%s/scene/%s.tif", depth, name);
    put(path, value + 100.0f);
}

static int begin(void **state)
{
    (void)state;
    const char *folder = getenv("TMPDIR");
    snprintf(root, sizeof root, "%s/hadalens-set-XXXXXX", folder ? folder : P_tmpdir);
    if (!mkdtemp(root))
        return 1;
    snprintf(set, sizeof set, "%s/set", root);
    return 0;
}

static int end(void **state)
{
    (void)state;
    hada_folder_remove(root);
    return 0;
}

/* Scanning fails with that status; the message holds every word. */
static void refused(int skip, hada_status status, const char *const *words)
{
    DEFAULTS(hada_dataset_options, options);
    hada_dataset *data = (hada_dataset *)&options;
    hada_error error = {0};
    options.skip_incomplete = skip;
    assert_int_equal(hada_dataset_scan(&data, set, &options, &error), status);
    assert_null(data);
    for (; *words; words++)
        if (!strstr(error.message, *words))
            fail_msg("no '%s' in: %s", *words, error.message);
}

#define REFUSED(skip, status, ...) refused(skip, status, (const char *const[]){__VA_ARGS__, NULL})

TEST(depths_ascend_and_pairs_are_sorted_by_name)
{
    hada_dataset *data;
    put_pair("z100mm", "b", 1);
    put_pair("z100mm", "a", 2);
    put_pair("20.5mm", "one", 3);
    put_pair("Z1e3mm", "far", 4);
    /* endings may differ between partners; names that mean nothing are passed over */
    put("Z1e3mm/raw/last.TIFF", 5);
    put("Z1e3mm/scene/last.tif", 105);
    put("notes/raw/a.tif", 0);
    put("zmm/raw/a.tif", 0);
    put("z5cm/raw/a.tif", 0);
    put("z-5mm/raw/a.tif", 0);
    put("5mm lens/raw/a.tif", 0);
    ASSERT_OK(hada_file_write(at("z100mm/raw/readme.txt"), "x", 1, err));
    ASSERT_OK(hada_dataset_scan(&data, set, NULL, err));
    const hada_dataset_info *info = hada_dataset_get_info(data);
    assert_int_equal(info->depths, 3);
    assert_true(info->distances_mm[0] == 20.5 && info->distances_mm[1] == 100.0 && info->distances_mm[2] == 1000.0);
    assert_true(info->counts[0] == 1 && info->counts[1] == 2 && info->counts[2] == 2);
    assert_true(info->pairs == 5 && info->least_pairs == 1 && info->incomplete == 0);
    assert_string_equal(info->incomplete_text, "");
    assert_true(!info->psf && !info->camera);
    assert_string_equal(hada_dataset_get_info(data)->folders[2], at("Z1e3mm"));
    assert_string_equal(hada_dataset_get_info(data)->files[1][0].raw, at("z100mm/raw/a.tif"));
    assert_string_equal(hada_dataset_get_info(data)->files[1][1].scene, at("z100mm/scene/b.tif"));
    assert_string_equal(hada_dataset_get_info(data)->files[2][1].raw, at("Z1e3mm/raw/last.TIFF"));
    assert_string_equal(hada_dataset_get_info(data)->files[2][1].scene, at("Z1e3mm/scene/last.tif"));
    hada_image raw, scene;
    ASSERT_OK(hada_dataset_read(data, 1, 0, &raw, &scene, err));
    assert_true(raw.data[5] == 2.0f && scene.data[0] == 102.0f && raw.rows == 2 && scene.cols == 3);
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    /* a file that went away since: the message names it, and nothing is held */
    unlink(at("z100mm/scene/a.tif"));
    ASSERT_FAILS(hada_dataset_read(data, 1, 0, &raw, &scene, err), HADA_ERROR_FILE_OPEN, "z100mm/scene/a.tif");
    assert_true(!raw.data && !scene.data);
    hada_dataset_destroy(&data);
    assert_null(data);
}

TEST(neighbours_are_found)
{
    SCOPED(hada_dataset) * data;
    put_pair("z1mm", "a", 1);
    put("psf.tif", 0);
    ASSERT_OK(hada_file_write(at("camera.json"), "{}", 2, err));
    ASSERT_OK(hada_dataset_scan(&data, set, NULL, err));
    assert_string_equal(hada_dataset_get_info(data)->psf, at("psf.tif"));
    assert_string_equal(hada_dataset_get_info(data)->camera, at("camera.json"));
}

TEST(files_without_partner_are_reported)
{
    SCOPED(hada_dataset) * data;
    DEFAULTS(hada_dataset_options, options);
    put_pair("z1mm", "a", 1);
    put("z1mm/raw/alone.tif", 1);
    REFUSED(0, HADA_ERROR_DATASET, "1 file has no partner", "z1mm/raw/alone.tif has no scene",
            "options.skip_incomplete");
    put("z1mm/scene/b.tif", 1);
    REFUSED(0, HADA_ERROR_DATASET, "2 files have no partner", "z1mm/scene/b.tif has no raw frame");
    for (char name[] = "z1mm/scene/c.tif"; name[11] < 'g'; name[11]++)
        put(name, 1);
    REFUSED(0, HADA_ERROR_DATASET, "6 files have no partner", "and so on");
    options.skip_incomplete = 1;
    ASSERT_OK(hada_dataset_scan(&data, set, &options, err));
    assert_int_equal(hada_dataset_get_info(data)->pairs, 1);
    assert_int_equal(hada_dataset_get_info(data)->incomplete, 6);
    assert_non_null(strstr(hada_dataset_get_info(data)->incomplete_text, "alone.tif has no scene"));
}

/* Partners are found by the name before the ending, whatever order whole names have ('-' stands before '.'). */
TEST(partners_have_the_same_stem)
{
    static const char *const names[] = {"a", "a-b", "a.b", "a b", "a0", "a.", "-", "b"};
    enum { NAMES = sizeof names / sizeof *names };
    char path[100];
    hada_dataset *data;
    snprintf(set, sizeof set, "%s/stems", root);
    for (int i = 0; i < NAMES; i++) {
        snprintf(path, sizeof path, "z5mm/raw/%s.tif", names[i]);
        put(path, (float)i);
        snprintf(path, sizeof path, "z5mm/scene/%s.TIFF", names[NAMES - 1 - i]);
        put(path, 100.0f + (float)(NAMES - 1 - i));
    }
    ASSERT_OK(hada_dataset_scan(&data, set, NULL, err));
    assert_int_equal(hada_dataset_get_info(data)->pairs, NAMES);
    for (int i = 0; i < NAMES; i++) {
        hada_image raw, scene;
        ASSERT_OK(hada_dataset_read(data, 0, i, &raw, &scene, err));
        assert_true(scene.data[0] == raw.data[0] + 100.0f);
        hada_image_destroy(&raw);
        hada_image_destroy(&scene);
        /* in the order of whole names, which decides what is held out */
        assert_true(!i || strcmp(hada_dataset_get_info(data)->files[0][i - 1].raw,
                                 hada_dataset_get_info(data)->files[0][i].raw) < 0);
    }
    hada_dataset_destroy(&data);
    snprintf(set, sizeof set, "%s/set", root);
}

TEST(folders_that_are_none_are_refused)
{
    hada_dataset *data;
    REFUSED(0, HADA_ERROR_FILE_OPEN, "set");
    ASSERT_FAILS(hada_dataset_scan(&data, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
    put("other/raw/a.tif", 1);
    REFUSED(0, HADA_ERROR_DATASET, "z<distance>mm", "z100mm/scene/NAME.tif");
    put("z7mm/scene/a.tif", 1);
    REFUSED(1, HADA_ERROR_DATASET, "z7mm has no folder 'raw'");
    put("z7mm/raw/b.tif", 1);
    REFUSED(1, HADA_ERROR_DATASET, "z7mm holds no pair");
    put("z7mm/raw/a.tif", 1);
    put_pair("z7.0mm", "a", 1);
    REFUSED(1, HADA_ERROR_DATASET, "z7mm", "z7.0mm", "the same distance");
    put_pair("z0mm", "a", 1);
    REFUSED(1, HADA_ERROR_DATASET, "z0mm", "above 0");
}

/* Of one depth the distance need not be known. */
TEST(one_depth_may_be_at_an_unknown_distance)
{
    for (int i = 0; i < 2; i++) {
        SCOPED(hada_dataset) * data;
        snprintf(set, sizeof set, "%s/unknown%d", root, i);
        put_pair(i ? "z0mm" : ".", "a", 1);
        ASSERT_OK(hada_dataset_scan(&data, set, NULL, err));
        assert_int_equal(hada_dataset_get_info(data)->depths, 1);
        assert_true(hada_dataset_get_info(data)->distances_mm[0] == 0.0);
    }
    snprintf(set, sizeof set, "%s/set", root);
}

TEST(two_parts_have_every_pair_once)
{
    static const struct {
        double hold_out;
        int near, far; /* held out of 5 and of 2 */
    } cases[] = {{0, 0, 0}, {1, 1, 1}, {0.2, 1, 0}, {0.4, 2, 1}, {0.01, 1, 0}};
    hada_dataset *data, *learn, *held;
    for (char name[] = "a"; *name <= 'e'; (*name)++)
        put_pair("z1mm", name, 1);
    put_pair("z2mm", "a", 1);
    put_pair("z2mm", "b", 1);
    ASSERT_OK(hada_dataset_scan(&data, set, NULL, err));
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        ASSERT_OK(hada_dataset_split(data, cases[i].hold_out, &learn, &held, err));
        const int *kept = hada_dataset_get_info(learn)->counts, *out = hada_dataset_get_info(held)->counts;
        assert_true(out[0] == cases[i].near && out[1] == cases[i].far);
        assert_true(kept[0] == 5 - out[0] && kept[1] == 2 - out[1]);
        for (int pair = 0; pair < 5; pair++)
            assert_string_equal(pair < kept[0] ? hada_dataset_get_info(learn)->files[0][pair].raw
                                               : hada_dataset_get_info(held)->files[0][pair - kept[0]].raw,
                                hada_dataset_get_info(data)->files[0][pair].raw);
        hada_dataset_destroy(&learn);
        hada_dataset_destroy(&held);
    }
    ASSERT_FAILS(hada_dataset_split(data, 2, &learn, &held, err), HADA_ERROR_DATASET, "z2mm has 2 pairs");
    assert_true(!learn && !held);
    static const double wrong[] = {-1, 1.5, NAN, 1e9};
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++)
        ASSERT_FAILS(hada_dataset_split(data, wrong[i], &learn, &held, err), HADA_ERROR_ARGUMENT, "");
    hada_dataset_destroy(&data);
}

TEST(dark_frames_are_means_over_pages)
{
    hada_image page, mean;
    hada_tiff_writer *writer;
    double level;
    ASSERT_OK(hada_folder_ensure(set, err));
    ASSERT_OK(hada_image_create(&page, 1, 2, 2, err));
    ASSERT_OK(hada_tiff_create(&writer, at("dark.tif"), 1, 2, 2, NULL, err));
    for (int t = 0; t < 4; t++) {
        for (int i = 0; i < 4; i++)
            page.data[i] = (float)(t + i);
        ASSERT_OK(hada_tiff_write(writer, &page, err));
    }
    ASSERT_OK(hada_tiff_finish(&writer, err));
    ASSERT_OK(hada_dark_frame_load(&mean, &level, at("dark.tif"), err));
    for (int i = 0; i < 4; i++)
        assert_true(mean.data[i] == 1.5f + (float)i);
    assert_true(level == 3.0);
    hada_image_destroy(&mean);
    page.data[0] = NAN;
    ASSERT_OK(hada_tiff_save(at("bad.tif"), &page, NULL, err));
    ASSERT_FAILS(hada_dark_frame_load(&mean, NULL, at("bad.tif"), err), HADA_ERROR_NOT_FINITE, "bad.tif");
    assert_null(mean.data);
    /* as many pixels in another shape */
    ASSERT_OK(hada_tiff_save(at("shapes.tif"), &page, NULL, err));
    TIFF *tif = TIFFOpen(at("shapes.tif"), "a");
    assert_non_null(tif);
    TIFFSetField(tif, TIFFTAG_IMAGEWIDTH, 4);
    TIFFSetField(tif, TIFFTAG_IMAGELENGTH, 1);
    TIFFSetField(tif, TIFFTAG_BITSPERSAMPLE, 32);
    TIFFSetField(tif, TIFFTAG_SAMPLESPERPIXEL, 1);
    TIFFSetField(tif, TIFFTAG_SAMPLEFORMAT, SAMPLEFORMAT_IEEEFP);
    TIFFSetField(tif, TIFFTAG_PHOTOMETRIC, PHOTOMETRIC_MINISBLACK);
    assert_int_equal(TIFFWriteScanline(tif, page.data, 0, 0), 1);
    TIFFClose(tif);
    ASSERT_FAILS(hada_dark_frame_load(&mean, NULL, at("shapes.tif"), err), HADA_ERROR_SIZE, "");
    hada_image_destroy(&page);
}

/* Pairs of the caller's: a raw frame of the depth's number, a scene of the pair's. */
static hada_status read_callers(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    hada_status status;
    if (*(int *)user == pair)
        return HADA_OK; /* forgets the images */
    if ((status = hada_image_create(raw, 1, 4, 5, err)) || (status = hada_image_create(scene, 1, 2, 3, err)))
        return status;
    raw->data[0] = (float)depth;
    scene->data[0] = (float)pair;
    return HADA_OK;
}

/* A failure without a message. */
static hada_status read_nothing(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    (void)user, (void)depth, (void)pair, (void)raw, (void)scene, (void)err;
    return HADA_ERROR_FILE_OPEN;
}

TEST(callers_give_pairs)
{
    const double distances[] = {100.0, 250.5}, wrong[] = {250.5, 100.0};
    const int counts[] = {3, 4}, none[] = {3, -1};
    int forgotten = -1;
    hada_dataset *data, *learn, *held;
    hada_image raw, scene;
    ASSERT_OK(hada_dataset_create(&data, 2, distances, counts, read_callers, &forgotten, NULL, err));
    const hada_dataset_info *info = hada_dataset_get_info(data);
    assert_int_equal(info->pairs, 7);
    assert_int_equal(info->least_pairs, 3);
    assert_true(info->distances_mm[1] == 250.5);
    assert_string_equal(hada_dataset_get_info(data)->files[1][2].scene, "z250.5mm/scene/2");
    ASSERT_OK(hada_dataset_split(data, 1.0, &learn, &held, err));
    ASSERT_OK(hada_dataset_read(held, 1, 0, &raw, &scene, err));
    assert_true(raw.data[0] == 1.0f && scene.data[0] == 3.0f); /* the last one keeps its number */
    hada_image_destroy(&raw);
    hada_image_destroy(&scene);
    forgotten = 2;
    ASSERT_FAILS(hada_dataset_read(learn, 1, 2, &raw, &scene, err), HADA_ERROR_DATASET, "");
    assert_null(raw.data);
    hada_dataset_destroy(&learn);
    hada_dataset_destroy(&held);
    hada_dataset_destroy(&data);
    ASSERT_OK(hada_dataset_create(&data, 2, distances, counts, read_nothing, NULL, NULL, err));
    ASSERT_FAILS(hada_dataset_read(data, 1, 2, &raw, &scene, err), HADA_ERROR_FILE_OPEN, "z250.5mm/raw/2");
    hada_dataset_destroy(&data);

    ASSERT_FAILS(hada_dataset_create(&data, 2, wrong, counts, read_callers, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
    ASSERT_FAILS(hada_dataset_create(&data, 2, distances, none, read_callers, NULL, NULL, err), HADA_ERROR_ARGUMENT,
                 "");
    ASSERT_FAILS(hada_dataset_create(&data, 2, distances, counts, NULL, NULL, NULL, err), HADA_ERROR_ARGUMENT, "");
    assert_null(data);
}

/* A pair is read once while there is room, and again where there is none. */
TEST(pairs_are_read_once)
{
    hada_dataset *data, *learn, *held;
    hada_pair pair, again;
    hada_error failure;
    hada_folder_remove(set);
    put_pair("z100mm", "a", 1.0f);
    put_pair("z100mm", "b", 2.0f);
    put_pair("z200mm", "a", 3.0f);
    put_pair("z200mm", "b", 4.0f);
    DEFAULTS(hada_dataset_options, options);
    options.cache_bytes = 2 * 2 * 6 * sizeof(float) - 1; /* a byte too little for a second pair */
    ASSERT_OK(hada_dataset_scan(&data, set, &options, err));
    ASSERT_OK(hada_pair_take(&pair, data, 1, 0, err));
    assert_true(pair.raw->data[0] == 3.0f && pair.scene->data[5] == 103.0f && !pair.own.raw.data);
    assert_int_equal(unlink(at("z200mm/raw/a.tif")), 0); /* is not looked at any more, by parts neither */
    ASSERT_OK(hada_dataset_split(data, 1, &learn, &held, err));
    ASSERT_OK(hada_pair_take(&again, learn, 1, 0, err));
    assert_true(again.raw == pair.raw && again.scene == pair.scene);
    hada_pair_return(&pair);
    hada_pair_return(&again);
    hada_dataset_destroy(&data); /* its parts keep what they share */
    for (int i = 0; i < 2; i++) {
        ASSERT_OK(hada_pair_take(&pair, i ? held : learn, 0, 0, err));
        assert_true(pair.raw->data[0] == 1.0f + (float)i && pair.raw == &pair.own.raw);
        hada_pair_return(&pair);
    }
    assert_int_equal(unlink(at("z100mm/raw/b.tif")), 0);
    assert_int_not_equal(hada_pair_take(&pair, held, 0, 0, &failure), HADA_OK);
    hada_dataset_destroy(&learn);
    hada_dataset_destroy(&held);
}

/* What a thread reads ahead is what is taken, and an error of it comes with its pair. */
TEST(pairs_are_read_ahead)
{
    hada_dataset *data;
    hada_pair pair;
    hada_error failure;
    hada_folder_remove(set);
    for (char name[] = "a"; *name <= 'f'; (*name)++)
        put_pair("z100mm", name, (float)(*name - 'a'));
    DEFAULTS(hada_dataset_options, options);
    for (int room = 0; room < 2; room++) {
        options.cache_bytes = room ? 1000000 : 0;
        ASSERT_OK(hada_dataset_scan(&data, set, &options, err));
        assert_int_equal(rename(at("z100mm/raw/e.tif"), at("z100mm/hidden")), 0);
        for (int i = 0; i < 6; i++) {
            if (i < 5)
                hada_pair_expect(data, 0, i + 1);
            const hada_status status = hada_pair_take(&pair, data, 0, i, &failure);
            assert_int_equal(status, i == 4 ? HADA_ERROR_FILE_OPEN : HADA_OK);
            assert_true(status ? strstr(failure.message, "raw/e.tif") != NULL : pair.raw->data[0] == (float)i);
            hada_pair_return(&pair);
        }
        hada_pair_expect(data, 0, 0); /* and is never taken */
        hada_dataset_destroy(&data);
        assert_int_equal(rename(at("z100mm/hidden"), at("z100mm/raw/e.tif")), 0);
    }
}

/* Images in memory are used where they are; but a grey scene is a coloured one for a coloured frame. */
TEST(images_are_not_copied)
{
    const double distances[] = {100.0, 250.0};
    const int counts[] = {1, 2};
    hada_image raws[3], scenes[3];
    SCOPED(hada_dataset) * data;
    hada_pair pair;
    for (int i = 0; i < 3; i++) {
        ASSERT_OK(hada_image_create(&raws[i], i ? 1 : 3, 4, 5, err));
        ASSERT_OK(hada_image_create(&scenes[i], 1, 2, 3, err));
    }
    ASSERT_OK(hada_dataset_from_images(&data, 2, distances, counts, raws, scenes, err));
    assert_int_equal(hada_dataset_get_info(data)->has_files, 0);
    ASSERT_OK(hada_pair_take(&pair, data, 1, 1, err));
    assert_true(pair.raw == &raws[2] && pair.scene == &scenes[2]);
    hada_pair_return(&pair);
    scenes[0].data[4] = 7.0f;
    ASSERT_OK(hada_pair_take(&pair, data, 0, 0, err));
    assert_true(pair.raw == &raws[0] && pair.scene->channels == 3 && pair.scene->data[10] == 7.0f);
    hada_pair_return(&pair);
    hada_image_destroy(&scenes[1]);
    ASSERT_FAILS(hada_pair_take(&pair, data, 1, 0, err), HADA_ERROR_ARGUMENT, "a scene is an empty image");
    for (int i = 0; i < 3; i++) {
        hada_image_destroy(&raws[i]);
        hada_image_destroy(&scenes[i]);
    }
}

enum { BRIGHT = 12, WIDE = 12 }; /* frames whose upper half is saturated in red, but for noise */

static hada_status read_bright(void *user, int depth, int pair, hada_image *raw, hada_image *scene, hada_error *err)
{
    const hada_mosaic mosaic = *(const hada_mosaic *)user;
    hada_status status;
    (void)depth;
    (void)pair;
    if ((status = hada_image_create(raw, mosaic ? 1 : 3, BRIGHT, WIDE, err)) ||
        (status = hada_image_create(scene, 3, BRIGHT, WIDE, err)))
        return status;
    for (int i = 0; i < (int)hada_image_count(raw); i++) {
        const int red = mosaic ? hada_mosaic_channel(mosaic, i / WIDE, i % WIDE) == 0 : i < BRIGHT * WIDE;
        raw->data[i] = red && i / WIDE < BRIGHT / 2 ? 0.8f : 0.001f * (float)(i % 97);
    }
    return HADA_OK;
}

/* Which values are saturated is known although a dark and a flat frame, binning and mixed colours change them. */
TEST(saturated_values_stay_known)
{
    static const double unmix[HADA_COLOUR_MATRIX] = {0.8, 0.2, 0, 0.1, 0.8, 0.1, 0, 0.2, 0.8}, distance = 100.0;
    const int count = 1;
    SCOPED(hada_image) dark, flat;
    ASSERT_OK(hada_image_create(&dark, 3, BRIGHT, WIDE, err));
    ASSERT_OK(hada_image_create(&flat, 3, BRIGHT, WIDE, err));
    for (int i = 0; i < 3 * BRIGHT * WIDE; i++) {
        dark.data[i] = 0.0001f * (float)(i % 7);
        flat.data[i] = 0.9f + 0.01f * (float)(i % 11);
    }
    for (int k = 0; k < 6; k++) {
        const hada_mosaic mosaic = k > 3 ? HADA_MOSAIC_RGGB : HADA_MOSAIC_NONE;
        const int binned = k == 2, mixed = k == 3 || k == 5, rows = binned ? BRIGHT / 2 : BRIGHT,
                  cols = binned ? WIDE / 2 : WIDE;
        hada_dataset *data, *part = NULL;
        hada_pair pair;
        DEFAULTS(hada_dataset_options, how);
        how.mosaic = mosaic;
        how.downsample = binned ? 2 : 1;
        how.dark_frame = k && !mosaic ? &dark : NULL;
        how.flat_frame = k && !mosaic ? &flat : NULL;
        ASSERT_OK(hada_dataset_create(&data, 1, &distance, &count, read_bright, (void *)(uintptr_t)&mosaic, &how, err));
        if (mixed)
            ASSERT_OK(hada_dataset_unmix(&part, data, unmix, err));
        ASSERT_OK(hada_pair_take(&pair, mixed ? part : data, 0, 0, err));
        assert_non_null(pair.weights);
        assert_true(pair.weights->channels == 3 && pair.weights->rows == rows && pair.weights->cols == cols);
        for (int i = 0; i < 3 * rows * cols; i++) {
            const int bound = i / cols % rows < rows / 2;
            const float wanted = !bound || (i >= rows * cols && !mixed) ? 1.0f : mixed ? 0.0f : -1.0f;
            assert_float_equal(pair.weights->data[i], wanted, 0.0f);
        }
        hada_pair_return(&pair);
        hada_dataset_destroy(&part);
        hada_dataset_destroy(&data);
    }
}

FIXTURE_OF_EACH(begin, end)
