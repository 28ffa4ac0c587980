/* Waiting until the disk has what was written. Internal. */
#ifndef HADA_CORE_SYNC_H
#define HADA_CORE_SYNC_H

/* All give 0, or -1 with the reason in errno. What a file system cannot do (folders on some) counts as done. */
int hada_sync(int fd);
/* The folder that `path` stands in: its names outlast a loss of power. */
int hada_sync_parent(const char *path);
/* A folder and all that is in it. */
int hada_sync_tree(const char *path);

/* Makes a folder and those above it, where they are missing, with this mode (less what the umask takes); their names
 * outlast a loss of power. A folder that is there already is fine. */
int hada_folders_make(const char *path, unsigned mode);

#endif
