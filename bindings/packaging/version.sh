#!/bin/sh
# The version of the sources, which stands in the headers alone.
sed -n 's/^#define HADALENS_VERSION *"\(.*\)"$/\1/p' "$(dirname "$0")/../../lib/include/hadalens/base.h"
