#!/usr/bin/env bash
# The Python source package: the same bytes twice, and pip makes a working wheel from it alone.
#   tests/packages/sdist.sh FOLDER
# In the environment of the Python tests (tests/python/environment.sh), which is made where it is missing.
set -euo pipefail
[ $# = 1 ] || { sed -n '3s/^# *//p' "$0" >&2; exit 2; }
folder=$(realpath -m "$1")
cd "$(dirname "$0")/../.."
environment=$PWD/build/python
"$environment/bin/python" -c 'import scikit_build_core, cffi' 2>/dev/null || tests/python/environment.sh build/python ||
    { echo "the environment of the Python tests cannot be made: skipped"; exit 77; }
rm -rf "$folder"
bindings/packaging/dist.sh "$folder/a" "$environment/bin/python"
bindings/packaging/dist.sh "$folder/b" "$environment/bin/python" >/dev/null
sdist=$(ls "$folder"/a/sdist/*.tar.gz)
cmp "$sdist" "$folder/b/sdist/${sdist##*/}"
# what only tests and benchmarks need stays away
tar -tzf "$sdist" >"$folder/held"
for unwanted in /tests/ /perf/ /docs/pictures/ /.ci/; do
    ! grep -q "^[^/]*$unwanted" "$folder/held" || { echo "the sdist holds $unwanted"; exit 1; }
done
PYTHONPATH= "$environment/bin/pip" wheel --quiet --no-build-isolation --no-deps --wheel-dir "$folder/wheel" "$sdist"
"$environment/bin/pip" install --quiet --no-deps --target "$folder/installed" "$folder"/wheel/*.whl
cd "$folder"
PYTHONPATH=$folder/installed "$environment/bin/python" -c '
import hadalens, os
assert hadalens.__file__.startswith(os.environ["PYTHONPATH"]), hadalens.__file__
print("hadalens", hadalens.__version__, "of", hadalens.__file__)'
