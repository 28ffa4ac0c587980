#!/usr/bin/env bash
# A first look, without a camera: builds Hadalens, designs a small lensless camera, learns it from simulated pairs,
# reconstructs frames whose scene stands at two depths, and measures how good the result is.
#
#   examples/demo.sh [FOLDER OF TIFF PICTURES]
#
# Results are left in build/demo. Running it again starts that folder afresh.
set -euo pipefail
pictures=${1:-procedural}
[ "$pictures" = procedural ] || pictures=$(cd "$pictures" && pwd)
cd "$(dirname "${BASH_SOURCE[0]}")/.."
program=build/release/bindings/cli/hadalens
out=build/demo

say() { printf '\n== %s\n' "$*"; }

source examples/install.sh
hadalens_install

say "Building (build/release)"
cmake --preset release -DHADALENS_TESTS=OFF >/dev/null
cmake --build build/release --target hadalens_cli -j "$(nproc)" | tail -n 1

say "The OpenCL devices here"
"$program" devices

rm -rf "$out"
mkdir -p "$out"

say "Designing a camera: 29 lenses before a 300x400 sensor, four distances; the first run compiles the kernels"
"$program" simulate --preset sim300 --scenes "$pictures" --test 2 -o "$out/camera"

say "Learning it from 8 pairs of frame and scene per distance"
"$program" fit "$out/camera" -o "$out/camera.model"

say "Reconstructing frames that it never saw"
"$program" reconstruct "$out"/camera/test/raw/*.tif -m "$out/camera.model" -o "$out/pictures"

say "The same with the linear filters alone (--refine 0), for comparison"
"$program" reconstruct "$out"/camera/test/raw/*.tif -m "$out/camera.model" -o "$out/linear" --refine 0

say "How good is it? Refined:"
"$program" evaluate "$out/pictures" "$out/camera/test/truth"
say "Linear:"
"$program" evaluate "$out/linear" "$out/camera/test/truth"

say "Look at"
printf '   %s\n' "$PWD/$out"/pictures/*_preview.png
echo "The stacks beside them (NAME_stack.tif) open in ImageJ or Fiji."
