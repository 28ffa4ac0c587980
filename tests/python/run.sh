#!/usr/bin/env bash
# run.sh MODULE [ARGUMENTS]: a Python module in the environment that environment.sh made in build/python, or in another
# one that ENVIRONMENT names (python-torch); skipped without one.
folder=$(cd "$(dirname "$0")/../.." && pwd)/build/${ENVIRONMENT:-python}
python=$folder/bin/python
[ -f "$folder/requirements.txt" ] || { echo "skipped: tests/python/environment.sh build/python makes the environment"; exit 77; }
exec "$python" -m "$@"
