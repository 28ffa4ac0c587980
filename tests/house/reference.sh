#!/bin/sh
# The reference can be made without a warning. Skips (77) where doxygen is missing.
set -eu
command -v doxygen >/dev/null || {
    echo "doxygen is missing (Debian: apt-get install doxygen): the reference is not made"
    exit 77
}
doxygen "$1"
