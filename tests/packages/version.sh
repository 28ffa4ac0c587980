#!/bin/sh
# The version is that of the headers; packages that repeat it must agree. version.sh SOURCE VERSION SOVERSION
set -eu
cd "$1"
version=$2 soversion=$3 status=0
same() { [ "$2" = "$3" ] || { echo "$1 says '$2', and should say '$3'"; status=1; }; }
same bindings/packaging/version.sh "$(bindings/packaging/version.sh)" "$version"
same "HADALENS_VERSION_MAJOR, _MINOR and _PATCH" \
    "$(sed -n 's/^#define HADALENS_VERSION_[MP][A-Z]* *\([0-9]*\)$/\1/p' lib/include/hadalens/base.h | paste -sd .)" "$version"
same bindings/packaging/debian/changelog "$(sed -n '1s/^hadalens (\(.*\)-[0-9.]*) .*/\1/p' bindings/packaging/debian/changelog)" "$version"
same bindings/packaging/conda/recipe.yaml "$(sed -n 's/^  version: "\(.*\)"$/\1/p' bindings/packaging/conda/recipe.yaml)" "$version"
same "the symbols file's soname" "$(sed -n '1s/ .*//p' bindings/packaging/debian/libhadalens2.symbols)" "libhadalens.so.$soversion"
grep -q "^Package: libhadalens$soversion\$" bindings/packaging/debian/control || {
    echo "bindings/packaging/debian/control has no package libhadalens$soversion"
    status=1
}
grep -q "^## $version\$\|^## $version " CHANGELOG.md || {
    echo "CHANGELOG.md has no section $version"
    status=1
}
exit $status
