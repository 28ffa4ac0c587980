#!/usr/bin/env bash
# The source archive has the same bytes whoever makes it and when. dist.sh WORK
set -euo pipefail
work=$1
cd "$(dirname "$0")/../.."
git rev-parse --git-dir >/dev/null 2>&1 || { echo "no git checkout: a source archive cannot be made"; exit 77; }
rm -rf "$work"
bindings/packaging/dist.sh "$work/a" >/dev/null
(
    umask 077
    export TZ=Pacific/Kiritimati LC_ALL=C GIT_CONFIG_COUNT=2 GIT_CONFIG_KEY_0=tar.umask GIT_CONFIG_VALUE_0=user
    export GIT_CONFIG_KEY_1=core.autocrlf GIT_CONFIG_VALUE_1=true
    sleep 1
    bindings/packaging/dist.sh "$work/b" >/dev/null
)
archive=hadalens-$(bindings/packaging/version.sh).tar.gz
cmp "$work/a/$archive" "$work/b/$archive"
# it holds what is committed, in one folder
git ls-tree -r --name-only HEAD | sed "s#^#${archive%.tar.gz}/#" | LC_ALL=C sort >"$work/committed"
tar -tzf "$work/a/$archive" | grep -v '/$' | LC_ALL=C sort >"$work/held"
cmp "$work/committed" "$work/held"
rm -rf "$work"
