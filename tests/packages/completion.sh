#!/usr/bin/env bash
# Completion in bash and zsh: every option of every command, and what may follow it. completion.sh HADALENS COMPLETION WORK
set -euo pipefail
program=$1 completion=$2 work=$3
sources=$(cd "$(dirname "$0")/../.." && pwd)/bindings/cli
rm -rf "$work"
mkdir -p "$work/places"
cd "$work"
failed=0
fail() { echo "FAILED: $*"; failed=1; }
cp "$completion/hadalens" "$completion/_hadalens" . # _hadalens: the name by which zsh finds it
commands=$("$program" --help | sed -n '/^Commands:/,/^$/s/^  \([a-z]\+\) .*/\1/p')
[ "$(wc -w <<<"$commands")" -ge 10 ] || fail "only these commands: $commands"

# shellcheck source=/dev/null
source ./hadalens
compopt() { :; } # which works only while a person completes
complete_words() { # WORD...: the words of the command line; the last is being completed
    COMP_WORDS=("$@") COMP_CWORD=$(($# - 1)) COMPREPLY=()
    _hadalens
    printf '%s\n' "${COMPREPLY[@]}" | LC_ALL=C sort
}
expect() { # WHAT WORD...
    local what=$1 got
    shift
    got=$(complete_words "$@" | paste -sd' ')
    [ "$got" = "$what" ] || fail "'$*' completes to '$got', not '$what'"
}
touch a.tif places/b.tif
# what the tables let follow more than once may do so in zsh
[ "$(grep -rho '{HADA_OPTION_TEXTS,' "$sources" | wc -l)" = "$(grep -c "^ *'\*\('{-\|--\)" _hadalens)" ] ||
    fail "zsh knows others that may be given more than once: $(grep "^ *'\*\('{-\|--\)" _hadalens)"
for command in $commands; do
    # the options of the help are those of the manual (tests/cli/cli_words.sh)
    "$program" "$command" --help | grep -oE -- '^ {2,6}(-., )?--[a-z-]+' | grep -oE -- '--[a-z-]+' | LC_ALL=C sort >in_help
    complete_words hadalens "$command" -- >in_bash
    cmp -s in_help in_bash || fail "help and bash name different options of $command: $(diff in_help in_bash | paste -sd' ')"
    sed -n "/^    $command)\$/,/;;\$/p" _hadalens | grep -oE -- "--[a-z-]+(=|[['}])" | sed 's/.$//' | LC_ALL=C sort -u >in_zsh
    cmp -s in_help in_zsh || fail "help and zsh name different options of $command: $(diff in_help in_zsh | paste -sd' ')"
done
expect "fit" hadalens fi
expect "reconstruct" hadalens help rec
expect "circular padded" hadalens fit --boundary ""
expect "padded" hadalens fit --boundary = pa
expect "a.tif auto" hadalens reconstruct x.tif --dark a
expect "a.tif" hadalens reconstruct -m a
expect "places" hadalens fit pl
expect "places" hadalens reconstruct a.tif -o pl
expect "" hadalens reconstruct a.tif -o a
expect "" hadalens fit --alpha ""
expect "--crop-passes" hadalens fit --cro

# zsh reads it, and hands the same to _arguments, which checks the form of each
if command -v zsh >/dev/null; then
    for command in $commands; do
        "$program" "$command" --help | grep -oE -- '^ {2,6}(-., )?--[a-z-]+' | grep -oE -- '--[a-z-]+' | LC_ALL=C sort >in_help
        zsh -f -c '
            _arguments() { if [[ $1 = -C ]]; then state=arguments; words=('"$command"'); return 1; fi; print -rl -- "$@"; }
            words=(hadalens '"$command"'); . ./_hadalens' >said 2>&1 || true
        grep -oE -- '^[^[]*--[a-z-]+=?\[' said | grep -oE -- '--[a-z-]+=?\[$' | sed 's/=*\[$//' | LC_ALL=C sort -u >in_zsh
        cmp -s in_help in_zsh || fail "zsh hands other options of $command to _arguments: $(head -n 3 said)"
    done
    # as a person: a beginning, the tab key, and return
    cat >person.zsh <<'END'
zmodload zsh/zpty
zpty -b person 'TERM=dumb zsh -f -i'
zpty -w person 'PS1=; fpath=($PWD $fpath); autoload -U compinit; compinit -u -D; hadalens() print -r -- "RAN<$*>"; print re""ady'
zpty -r -m person said '*ready*'
while read -r line; do
    zpty -w -n person "$line"$'\t\r'
    zpty -r -m person said '*RAN<*>*'
    print -r -- ${${said#*RAN<}%>*}
done
END
    printf 'hadalens %s\n' 'recons' 'fit --cro' 'fit --boundary pad' 'fit --boundary=pad' 'reconstruct -m a.t' \
        'reconstruct a.tif -o pla' 'fit --dark non' >typed
    printf '%s\n' 'reconstruct' 'fit --crop-passes' 'fit --boundary padded' 'fit --boundary=padded' 'reconstruct -m a.tif' \
        'reconstruct a.tif -o places' 'fit --dark none' >meant
    timeout 300 zsh -f person.zsh <typed >ran || fail "zsh did not answer"
    diff meant ran || fail "zsh completes otherwise (>) than meant (<)"
fi
rm -rf "$work"
exit $failed
