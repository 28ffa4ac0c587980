#!/usr/bin/env bash
# All of the paper's experiments at a size that two cores finish: a table each, in OUT.
#   perf/paper/run.sh OUT [options for all, such as --build FOLDER --scenes FOLDER --test-scenes FOLDER]
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
out=$1
shift
mkdir -p "$out"
python3 "$here/random_features.py" "$out/features.safetensors"
for name in depths pairs starts conventional methods seeds; do
    case "$name" in
    depths) options="" ;;
    pairs | starts) options="--size 160x160 --window 60x60 --depths 2" ;;
    conventional) options="--size 192x192 --window 72x72" ;;
    *) options="--size 192x192 --window 72x72 --depths 3 --noise 0.03 --lpips $out/features.safetensors" ;;
    esac
    echo "== $name"
    # shellcheck disable=SC2086
    python3 "$here/$name.py" $options "$@" | tee "$out/$name.md"
done
