#!/usr/bin/env bash
# Do two programs compute the same bits, the whole way?
#   tests/golden/compare.sh OLD_HADALENS NEW_HADALENS [FOLDER]
#   tests/golden/compare.sh stored HADALENS [FOLDER]
# OLD_HADALENS may also be a list of hashes that whole_way.sh left earlier; 'stored' is the list in whole_way/ of
# machines like this one (of its processors' the nearest), or, where there is none, another run of the same program. The
# files stay in FOLDER (default: a scratch folder that is removed). Prints what differs; exit code 1 where something does.
set -euo pipefail
[ $# -ge 2 ] || { sed -n '2,7s/^# //p' "$0"; exit 2; }
here=$(dirname "$0")
if [ $# -ge 3 ]; then
    scratch=$3
    mkdir -p "$scratch"
else
    scratch=$(mktemp -d)
    trap 'rm -rf "$scratch"' EXIT
fi

old=("$1")
if [ "$1" = stored ]; then
    key=$(python3 "$here/golden_tool.py" key "$2")
    old=("$here/whole_way/$key.txt")
    [ -e "${old[0]}" ] || { echo "No list for $key: two runs are compared."; old=("$2"); }
    for cpu in $(ls "$here/whole_way" | grep -F "$key-"); do # of another processor: the lines that differ
        awk 'NR == FNR { h[$2] = $1; next } { print ($2 in h ? h[$2] : $1), $2 }' "$here/whole_way/$cpu" "$old" >"$scratch/$cpu"
        old+=("$scratch/$cpu")
    done
fi
if [ -x "${old[0]}" ]; then
    "$here/whole_way.sh" "${old[0]}" "$scratch/old"
    old=("$scratch/old/HASHES")
fi
"$here/whole_way.sh" "$2" "$scratch/new"
new=$scratch/new/HASHES
nearest=$(for list in "${old[@]}"; do echo "$(diff "$list" "$new" | wc -l) $list"; done | sort -n | sed -n '1s/^[0-9]* //p')

# lines of 'how file': changed, gone or new
sort -k 2 "$nearest" >"$scratch/old.list"
sort -k 2 "$new" >"$scratch/new.list"
join -1 2 -2 2 -a 1 -a 2 -e - -o 0,1.1,2.1 "$scratch/old.list" "$scratch/new.list" |
    awk '$2 != $3 { print ($2 == "-" ? "new    " : $3 == "-" ? "gone   " : "changed"), $1 }' >"$scratch/differences"
count=$(wc -l <"$scratch/differences")
echo "$count of $(wc -l <"$scratch/new.list") files differ"
cat "$scratch/differences"
[ "$count" = 0 ]
