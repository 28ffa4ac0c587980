#!/usr/bin/env bash
# The plugin's tests before a screen in memory, in the environment of environment.sh; skipped (77) without one.
cd "$(dirname "$0")/../../.." || exit 1
python=$PWD/build/python-napari/bin/python
[ -x "$python" ] && command -v Xvfb >/dev/null || {
    echo "skipped: bindings/napari/tests/environment.sh makes the environment"
    exit 77
}
exec xvfb-run --auto-servernum "$python" -m pytest -q bindings/napari/tests
