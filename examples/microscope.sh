#!/usr/bin/env bash
# A miniature microscope, from the stack of a bead to traces: a model from the stack, a volume for each frame of a film,
# its cells and beads as a table, their tracks, and the light of each over time.
#
#   examples/microscope.sh [FOLDER]       (build/microscope by default; begun afresh)
#
# microscope_film.py makes the stack and the film in place of yours. Needs `hadalens` in the PATH or built in
# build/release (HADALENS names another one), and Python 3. Half a minute.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
hadalens=${HADALENS:-$(command -v hadalens || echo "$here/build/release/bindings/cli/hadalens")}
out=${1:-$here/build/microscope}
rm -rf "$out"
mkdir -p "$out"
cd "$out"
export LC_ALL=C # numbers with a point

echo "the stack of a bead, and a film"
python3 "$here/examples/microscope_film.py" .

echo "the camera, from the stack: 20 depths from 2 mm on, 0.05 mm apart"
"$hadalens" fit --psf psf.npy --distances 2:0.05:20 --psf-dark 0 --window 96x96 -o microscope.model

echo "volumes, emitters and their tracks; a pixel is 4 micrometres in the scene"
"$hadalens" reconstruct film.npy -m microscope.model -o pictures --emitters --track-pixels 1.5 --track-depths 1.5 --pixel-um 4

echo "as good as this, against what was simulated"
"$hadalens" evaluate pictures/film_tracks.csv truth.csv

# a row for each frame, a column for each track of 12 frames or more; empty where it was not found
awk -F, 'NR == 1 { for (i = 1; i <= NF; i++) at[$i] = i; next }
    { light[$(at["track"]), $(at["frame"])] = $(at["amplitude"]); count[$(at["track"])]++
      frames = $(at["frame"]) > frames ? $(at["frame"]) : frames; tracks = $(at["track"]) }
    END { line = "frame"
          for (k = 0; k <= tracks; k++) if (count[k] >= 12) line = line ",track " k
          print line
          for (t = 0; t <= frames; t++) {
              line = t
              for (k = 0; k <= tracks; k++) if (count[k] >= 12) line = line "," light[k, t]
              print line } }' pictures/film_tracks.csv >traces.csv

# the first twelve of them as a picture
awk -F, 'NR == 1 { n = NF - 1 > 12 ? 12 : NF - 1; for (k = 1; k <= n; k++) name[k] = $(k + 1); next }
    { for (k = 1; k <= n; k++) { v[k, NR - 1] = $(k + 1); most = $(k + 1) > most ? $(k + 1) : most }; frames = NR - 1 }
    END { print "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"640\" height=\"" 30 * n + 40 "\" font-family=\"sans-serif\" font-size=\"12\">"
          print "<rect width=\"100%\" height=\"100%\" fill=\"white\"/>"
          for (k = 1; k <= n; k++) {
              points = ""
              for (t = 1; t <= frames; t++)
                  if (v[k, t] != "") points = points sprintf("%.1f,%.1f ", 60 + 560 * (t - 1) / (frames - 1), 30 * k + 20 - 45 * v[k, t] / most)
              print "<polyline fill=\"none\" stroke=\"#1b6ca8\" stroke-width=\"1.5\" points=\"" points "\"/><text x=\"10\" y=\"" 30 * k + 9 "\">" name[k] "</text>" }
          print "<text x=\"340\" y=\"" 30 * n + 36 "\" text-anchor=\"middle\">frame</text></svg>" }' traces.csv >traces.svg

printf '\nLook at %s/pictures/film_preview.png, traces.csv and traces.svg\n' "$out"
