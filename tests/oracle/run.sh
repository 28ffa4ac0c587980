#!/usr/bin/env bash
# run.sh ORACLE.py PROGRAM: an oracle in the environment that environment.sh made in build/oracle, else by python3.
here=$(cd "$(dirname "$0")" && pwd)
python=$here/../../build/oracle/bin/python
[ -x "$python" ] || python=python3
command -v "$python" >/dev/null || { echo "skipped: no Python"; exit 77; }
exec "$python" "$here/$1" "${@:2}"
