#!/usr/bin/env bash
# Tuning: measures on request, and the file it writes is honoured.
. "$(dirname "$0")/cli_testing.sh"

expect 2 'tuning file is missing.*-o FILE' tune
expect 2 '--size 16 is not a size' tune -o x --size 16
expect 2 '--size' tune -o x --size 0x16
expect 2 'one word too many' tune -o x 16x24
expect 3 'nosuchfolder/x' tune -o nosuchfolder/x --size 15x14 --rounds 1
expect 3 'not an ordinary file' tune -o . --size 15x14 --rounds 1
lacks x

# Both sizes are measured; 17 is a prime that clFFT lacks.
expect 0 '15x14 .*17x14 .*clfft: clFFT takes lengths with prime factors up to 13.*Wrote tuning.txt' tune -o tuning.txt \
    --size 15x14 --size 17x14 --rounds 3
grep -Eq '^fft cpu 15x14 (own|clfft)$' tuning.txt || fail "no line for 15x14"
grep -Eq '^fft cpu 17x14 own$' tuning.txt || fail "no line for 17x14"
files . 3 # with stdout and stderr

# A model: the transforms of its grid.
expect 0 'Wrote model.txt' tune -o model.txt -m "$model" --rounds 1
[ "$(grep -c '^fft' model.txt)" = 1 ] || fail "model: $(cat model.txt)"

# Wrong rows are refused by line, where the file is opened or where they would be used.
printf '# one\nfft cpu 15x14 ours\n' >wrong.txt
HADALENS_TUNING=wrong.txt expect 3 'wrong.txt, line 2 names an unknown choice: fft cpu 15x14 ours' tune -o x --size 15x14
lacks x

# Rows of a file are used; those about other things stay as they are.
printf 'fft gpu * clfft\nfft cpu 15x14 clfft\n# a remark without an end' >tuning.txt
HADALENS_TUNING=tuning.txt expect 0 '"before": "clfft"' tune -o tuning.txt --size 15x14 --rounds 3 --json
is_json 'tune'
grep -q '"forward_ms": [0-9]' stdout || fail "no times in the document"
chosen=$(sed -n 's/.*"chosen": "\(.*\)".*/\1/p' stdout)
printf 'fft gpu * clfft\n# a remark without an end\nfft cpu 15x14 %s\n' "$chosen" | cmp -s - tuning.txt ||
    fail "the tuning file became: $(cat tuning.txt)"
printf 'fft cpu 15x14 own\n' >tuning.txt
HADALENS_TUNING=tuning.txt expect 0 '"before": "own"' tune -o other.txt --size 15x14 --rounds 1 --json

# The whole job by the other back end gives the same pictures but for the last bits.
printf 'fft * * clfft\n' >clfft.txt
raw=$(find "$camera/test/raw" -name '*.tif' | head -n 1)
name=$(basename "$raw" .tif)
expect 0 '' reconstruct "$raw" -m "$model" -o table --refine 0
HADALENS_TUNING=clfft.txt expect 0 '' reconstruct "$raw" -m "$model" -o tuned --refine 0
HADALENS_TUNING=/nonexistent expect 0 '' reconstruct "$raw" -m "$model" -o missing --refine 0
same_results "table/${name}_aif.tif" "missing/${name}_aif.tif" || fail "a missing tuning file changed the result"
expect 0 '' evaluate "tuned/${name}_aif.tif" "table/${name}_aif.tif" --json
psnr=$(grep -o '"psnr[a-z_]*": [0-9.]*' stdout | head -n 1 | grep -o '[0-9.]*$')
awk -v p="${psnr:-0}" 'BEGIN { exit !(p > 80) }' || fail "PSNR between the back ends: ${psnr:-none}"
finish
