#!/usr/bin/env bash
# Help, manual pages, and command lines that cannot be followed.
. "$(dirname "$0")/cli_testing.sh"

expect 0 'hadalens [0-9]+\.[0-9]+' --version
expect 0 'Commands:.*simulate.*reconstruct' --help
expect 0 'Commands:' help
expect 2 'Commands:'
for command in devices optics simulate register fit train reconstruct evaluate tune bench; do
    expect 0 "Usage: +hadalens $command.*Examples:.*Exit codes:" "$command" --help
    expect 0 "Usage: +hadalens $command" help "$command"
    expect 0 '\.SH NAME.*\.SH OPTIONS.*\.SH EXIT STATUS' --man "$command"
    if command -v groff >/dev/null; then
        [ -z "$(groff -man -ww -z -Tutf8 stdout 2>&1)" ] || fail "troff complains about the manual of $command"
    fi
    # Every option of the help is in the manual, and the other way round.
    cp stdout manual
    expect 0 '' "$command" --help
    grep -oE -- '^ {2,6}(-., )?--[a-z-]+' stdout | grep -oE -- '--[a-z-]+' | sort >in_help
    sed 's/\\-/-/g; s/\\fR//g; s/\\fB//g' manual | grep -oE -- '^(-., )?--[a-z-]+' | grep -oE -- '--[a-z-]+' | sort \
        >in_manual
    cmp -s in_help in_manual || fail "help and manual of $command name different options"
done
expect 0 '\.SH COMMANDS' --man
expect 2 "no command 'recontsruct'; did you mean 'reconstruct'" recontsruct
expect 2 "no command 'xyzzy'.*--help" xyzzy
expect 2 "did you mean --device" devices --devise 0
expect 2 "there is no option --zzzzzz" devices --zzzzzz
expect 2 'needs a value' fit -o
expect 2 'one word too many' devices now

expect 2 'with -o DATASET' simulate
expect 2 "HEIGHTxWIDTH.*not '300'" simulate -o x --size 300
expect 2 "whole number.*not '8.5'" simulate -o x --pairs 8.5
expect 2 "takes a number.*not '1,5'" simulate -o x --near 1,5
expect 2 "one of circular\|padded, not 'round'" simulate -o x --boundary round
expect 2 'presets are .*sim300' simulate -o x --preset nosuch
expect 2 "seed takes a whole number below" simulate -o x --seed 18446744073709551615
expect 2 "seed takes a whole number below" simulate -o x --seed 99999999999999999999
expect 0 "pixels=4194304,pages=262144,text=8388608, *parameters=50000000" simulate --help
expect 2 'noise takes a number from 0 on' simulate -o x --noise -1
expect 2 'DATASET folder, --psf' fit -o x
expect 2 'resume goes on with the pairs' fit "$camera" -o x --resume
for option in alpha lambda outside psf-dark psf-gate save-seconds; do
    expect 2 "$option takes a number from 0 on" fit "$camera" -o x --$option -1
done
expect 2 'takes a number from 0 on' optics -o x --threshold -0.5
expect 2 'with -o MODEL' fit "$camera"
expect 2 'not both' fit "$camera" --psf p.tif -o x
expect 2 'need a PSF' fit "$camera" --form wiener -o x
expect 2 "--refine takes a whole number such as 8, or 'auto', not 'many'" fit "$camera" -o x --refine many
expect 2 'at least one raw frame' reconstruct -m "$model" -o x
expect 2 'with -m MODEL' reconstruct a.tif -o x
expect 2 'with -o FOLDER' reconstruct a.tif -m "$model"
expect 2 'two names' evaluate a
lacks x
# The same in JSON.
expect 2 '"exit_code": 2' fit --json
is_json 'usage error'
expect 2 '"HADA_ERROR_ARGUMENT"' devices --json --nosuch
is_json 'unknown option'
finish
