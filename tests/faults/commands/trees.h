/* Folders of results: copied, compared, removed. */
#ifndef HADA_TESTS_TREES_H
#define HADA_TESTS_TREES_H

typedef enum tree_want {
    TREE_SAME,    /* the same files with the same bytes */
    TREE_NAMES,   /* the same files */
    TREE_PARTS,   /* no other files, and those that are there with the same bytes */
    TREE_NOTHING, /* nothing, or what was there before */
    TREE_ANY
} tree_want;

/* All give 0 or -1, with errno. */
int tree_remove(const char *path);
/* Symbolic links to everything in a folder but what begins so (NULL: to everything). */
int tree_link(const char *from, const char *to, const char *but);
int tree_take(const char *from, const char *to, const char *prefix); /* moves what begins so, links aside */

int tree_has(const char *folder, const char *prefix);
/* Whether what begins with `prefix` in the folder is as wanted, against the other folder. */
int tree_is(const char *folder, const char *whole, const char *prefix, tree_want want);
/* The first name in a folder that is hidden or scratch, for messages; NULL where there is none. */
const char *tree_hidden(const char *folder);

#endif
