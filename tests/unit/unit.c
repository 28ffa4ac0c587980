/* Runs unit tests: a group is the tests of one file, test_fit.c is group `fit`. testing.h has the macros that add them.
 *   unit GROUP [PATTERN]   a group, or those of its tests whose names match (with * and ?)
 *   unit --list            the names of all groups */
#include "testing.h"

enum { GROUPS = 200, TESTS = 64, RUNS = 4 };

typedef struct run {
    CMFixtureFunction set_up, tear_down;
    struct CMUnitTest tests[TESTS];
    size_t count;
} run;

typedef struct group {
    const char *file;
    run runs[RUNS]; /* the first has all tests of the file */
    int count;
    CMFixtureFunction before_each, after_each;
} group;

static group groups[GROUPS];
static int group_count;

static void need(int condition, const char *what)
{
    if (condition)
        return;
    fprintf(stderr, "unit: %s\n", what);
    exit(2);
}

static group *group_of(const char *file)
{
    for (int i = 0; i < group_count; i++)
        if (!strcmp(groups[i].file, file))
            return &groups[i];
    need(group_count < GROUPS, "more than GROUPS groups");
    groups[group_count] = (group){.file = file, .count = 1};
    return &groups[group_count++];
}

void unit_add_test(const char *file, const char *name, CMUnitTestFunction test)
{
    run *all = &group_of(file)->runs[0];
    need(all->count < TESTS, "more than TESTS tests in a file");
    all->tests[all->count++] = (struct CMUnitTest){.name = name, .test_func = test};
}

void unit_set_fixture(const char *file, CMFixtureFunction set_up, CMFixtureFunction tear_down)
{
    run *all = &group_of(file)->runs[0];
    all->set_up = set_up;
    all->tear_down = tear_down;
}

void unit_set_fixture_of_each(const char *file, CMFixtureFunction set_up, CMFixtureFunction tear_down)
{
    group *of = group_of(file);
    of->before_each = set_up;
    of->after_each = tear_down;
}

void unit_run_again(const char *file, const CMUnitTestFunction *tests, size_t count, CMFixtureFunction set_up,
                    CMFixtureFunction tear_down)
{
    group *of = group_of(file);
    need(of->count < RUNS, "more than RUNS fixtures in a file");
    run *again = &of->runs[of->count++];
    again->set_up = set_up;
    again->tear_down = tear_down;
    for (size_t i = 0; i < count; i++)
        for (size_t k = 0; k < of->runs[0].count; k++)
            if (of->runs[0].tests[k].test_func == tests[i])
                again->tests[again->count++] = of->runs[0].tests[k];
    need(again->count == count, "AGAIN before the tests that it names");
}

/* The name of a file's group: "fit" of ".../test_fit.c". */
static const char *name_of(const char *file, char *name, size_t size)
{
    const char *slash = strrchr(file, '/'), *base = slash ? slash + 1 : file;
    base += strncmp(base, "test_", 5) ? 0 : 5;
    snprintf(name, size, "%.*s", (int)strcspn(base, "."), base);
    return name;
}

static int run_group(group *of, const char *name)
{
    int failed = 0;
    for (int i = 0; i < of->count; i++) {
        run *now = &of->runs[i];
        for (size_t k = 0; k < now->count; k++) {
            now->tests[k].setup_func = of->before_each;
            now->tests[k].teardown_func = of->after_each;
        }
        /* what cmocka_run_group_tests is, for a number of tests that no array states */
        failed += _cmocka_run_group_tests(name, now->tests, now->count, now->set_up, now->tear_down);
    }
    return failed;
}

int main(int argc, char **argv)
{
    char name[64];
    const int list = argc == 2 && !strcmp(argv[1], "--list");
    need(argc == 2 || argc == 3, "give the name of a group (--list shows them), and maybe a pattern of its tests");
    if (argc == 3)
        cmocka_set_test_filter(argv[2]);
    for (int i = 0; i < group_count; i++) {
        name_of(groups[i].file, name, sizeof name);
        if (list)
            puts(name);
        else if (!strcmp(name, argv[1]))
            return run_group(&groups[i], name) != 0;
    }
    need(list, "there is no such group (--list shows them)");
    return 0;
}
