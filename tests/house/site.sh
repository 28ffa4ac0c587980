#!/bin/sh
# The pages make a site without a warning: every link and anchor exists. Skips (77) where the generator is missing.
set -eu
command -v sphinx-build >/dev/null && "$(sed -n '1s/^#! *//p' "$(command -v sphinx-build)" | cut -d' ' -f1)" -c 'import myst_parser' 2>/dev/null || {
    echo "Sphinx or MyST is missing (Debian: apt-get install python3-sphinx python3-myst-parser): links are not checked"
    exit 77
}
cd "$1"
# -E: the side bar follows docs/README.md, whose changes the pages kept from the last time do not see
sphinx-build -E -W --keep-going -q -b dummy -c docs/site . "$2"
# pages: at most 25, so that a person finds the way in
pages=$(find docs -name '*.md' | wc -l)
[ "$pages" -le 25 ] || { echo "docs has $pages pages, at most 25"; exit 1; }
