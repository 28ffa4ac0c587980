#!/usr/bin/env bash
# The source archive of the commit at hand, and the Python source package made from it.
#   bindings/packaging/dist.sh FOLDER [PYTHON]
# FOLDER/hadalens-VERSION.tar.gz has the same bytes wherever and whenever it is made from a commit: files in git's order
# with the commit's time, owner and modes that do not depend on who makes it, a compressor's header without time. PYTHON
# (with scikit-build-core; tests/python/environment.sh makes one) also makes the sdist, FOLDER/sdist/hadalens-VERSION.tar.gz.
set -euo pipefail
[ $# -ge 1 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
folder=$(realpath -m "$1") python=${2:-}
cd "$(dirname "$0")/../.."
version=$(bindings/packaging/version.sh)
git rev-parse --git-dir >/dev/null 2>&1 || { echo "dist: a source archive is made from a git checkout" >&2; exit 2; }
[ -z "$(git status --porcelain --untracked-files=no)" ] || echo "dist: what is not committed is left out" >&2

mkdir -p "$folder"
archive=$folder/hadalens-$version.tar.gz
# whatever the person's configuration of git is
git -c tar.umask=0022 -c core.attributesFile=/dev/null -c core.autocrlf=false -c core.eol=lf \
    archive --format=tar --prefix="hadalens-$version/" HEAD | gzip -n -9 >"$archive.part"
mv "$archive.part" "$archive"

if [ -n "$python" ]; then
    python=$(realpath -s "$python")
    work=$(mktemp -d)
    trap 'rm -rf "$work"' EXIT
    tar -xf "$archive" -C "$work"
    mkdir -p "$folder/sdist"
    (cd "$work/hadalens-$version" && SOURCE_DATE_EPOCH=$(git -C "$OLDPWD" log -1 --format=%ct) \
        "$python" -c 'import sys; from scikit_build_core.build import build_sdist; build_sdist(sys.argv[1])' \
        "$folder/sdist" >/dev/null)
fi
(cd "$folder" && sha256sum *.tar.gz $([ -z "$python" ] || ls sdist/*.tar.gz))
