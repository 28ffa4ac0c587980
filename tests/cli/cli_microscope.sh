#!/usr/bin/env bash
# examples/microscope.sh: from the stack of a bead to traces.
. "$(dirname "$0")/cli_testing.sh"
bash "$(dirname "$0")/../../examples/microscope.sh" out >stdout 2>stderr || fail "the example"
awk '$1 == "film_tracks" { found = 1; good = $4 >= 0.99 && $6 < 0.1 && $7 < 0.5 && $8 <= 4 }
    END { exit !(found && good) }' stdout || fail "F1, errors or switches"
has out/pictures/film_stack.tif out/pictures/film_emitters.csv out/traces.svg
[ "$(wc -l <out/traces.csv)" = 25 ] || fail "lines of the traces"
[ "$(head -n 1 out/traces.csv | tr , '\n' | grep -c track)" -ge 30 ] || fail "tracks that last"
finish
