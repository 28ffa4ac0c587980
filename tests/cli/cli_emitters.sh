#!/usr/bin/env bash
# Points of light as a table: reconstruct --emitters.
. "$(dirname "$0")/cli_testing.sh"

# A camera's point spread function is the frame of a point on its axis.
"$FRAME_TOOL" spots spots.tif 64 64 20 5
"$FRAME_TOOL" pages spots.tif film.tif 2
expect 0 '' fit --psf spots.tif --distances 10 -o spots.model
expect 0 'film: 2 frames.*; 1 emitter; 1 track in all' reconstruct film.tif -m spots.model -o out --emitters
has out/film_stack.tif out/film_aif.tif
head -n 1 out/film_emitters.csv | grep -qx 'frame,x,y,z,distance_mm,amplitude,sd_x,sd_y,sd_z,sd_amplitude,residual' ||
    fail "header of the table"
[ "$(grep -c . out/film_emitters.csv)" = 3 ] || fail "lines of the table"
printf 'frame,x,y,z\n0,32,32,0\n1,32,32,0\n' >truth.csv
expect 0 'film_emitters +1.000 +1.000 +1.000 +1.000 +0.000 +0.000' evaluate out/film_emitters.csv truth.csv
expect 0 'film_emitters.csv.*"emitters": 1' reconstruct film.tif -m spots.model -o out --emitters --scene volume --json
is_json 'reconstruct --json of emitters'
# Tracks: those of both frames are one.
head -n 1 out/film_tracks.csv | grep -qx 'track,frame,x,y,z,distance_mm,amplitude,sd_x,sd_y,sd_z,sd_amplitude,residual' ||
    fail "header of the tracks"
[ "$(cut -d, -f1,2 out/film_tracks.csv | tr '\n' ' ')" = 'track,frame 0,0 0,1 ' ] || fail "lines of the tracks"
printf 'track,frame,x,y,z\n0,0,32,32,0\n1,1,32,32,0\n' >two_tracks.csv
expect 0 'two_tracks +1.000 .* 0.000 +1' evaluate two_tracks.csv out/film_tracks.csv
expect 0 'film: there already' reconstruct film.tif -m spots.model -o out --emitters --resume
for table in emitters tracks; do
    rm "out/film_$table.csv"
    expect 0 '1 emitter' reconstruct film.tif -m spots.model -o out --emitters --resume
    has "out/film_$table.csv"
done
expect 0 '1 emitter' reconstruct film.tif -m spots.model -o out --emitters --track-pixels 0 --track-depths 0 --track-gap 0
expect 0 '"switches": 0' evaluate out/film_tracks.csv out/film_tracks.csv --json
expect 2 'track-pixels takes a number from 0 on' reconstruct film.tif -m spots.model -o told --emitters --track-pixels -1
# The size of a pixel in the scene is told.
expect 0 '1 emitter' reconstruct film.tif -m spots.model -o out --emitters --pixel-um 2.5
grep -aqx 'unit=mm' out/film_stack.tif || fail "the unit of the stack"
expect 2 'pixel-um takes a number from 0 on' reconstruct film.tif -m spots.model -o told --pixel-um -1
# A single frame has none, and those of a run before go.
cp spots.tif film.tif
expect 0 'film: .*; 1 emitter;' reconstruct film.tif -m spots.model -o out --emitters
lacks out/film_tracks.csv
expect 0 'film: there already' reconstruct film.tif -m spots.model -o out --emitters --resume
"$FRAME_TOOL" pages spots.tif film.tif 2
expect 2 '--emitters are those of a volume' reconstruct film.tif -m spots.model -o told --emitters --scene planes
expect 2 'frame 1 of 2: emitters need light: leave --gamma out' reconstruct film.tif -m spots.model -o told --emitters --gamma 2
expect 4 'frames of one channel, and the model .* is for 3' \
    reconstruct "$camera/test/raw/test01.tif" -m "$model" -o told --emitters
lacks told/film_emitters.csv told/test01_emitters.csv told/film_stack.tif
finish
