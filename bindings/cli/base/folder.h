/* Names of files, and files that appear whole. */
#ifndef HADA_CLI_FOLDER_H
#define HADA_CLI_FOLDER_H

#include "cli.h"

#include <hadalens/folder.h>

/* Writes a file: all of it, or nothing. */
#define hada_cli_write_text hada_file_write

#endif
