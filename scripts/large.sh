#!/usr/bin/env bash
# What takes long and needs disk: a folder of 64 tiles that is larger than its budgets.
# POINTS (300M), FORMAT (laz or las; 3 or 10 GB), TMPDIR. docs/large.md says what it gave.
set -euo pipefail
cd "$(dirname "$0")/.."
cargo build --release --locked --quiet
lasray=$PWD/target/release/lasray
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
points=${POINTS:-300M}
suffix=()
[ "${FORMAT:-laz}" = las ] && suffix=(--las)
"$lasray" synth tiles --points "$points" --tiles 8x8 ${suffix[@]+"${suffix[@]}"}

# timed NAME ARGUMENT...: seconds, and peak memory of the whole process, driver included.
timed() {
    local name=$1
    shift
    /usr/bin/time -f "$name: %e s, %M KiB" "$lasray" render tiles --size 640x360 --quiet --no-cache "$@"
}
same() { cmp "$1" "$2" && echo "$1 and $2 are the same"; }

street=(--eye 512000,5402960,260 --target 512010,5403100,225)
for budget in 512MiB 1GiB; do
    timed "whole, $budget" -o "whole-$budget.png" --host-memory $budget --device-memory $budget
    timed "street, $budget" -o "street-$budget.png" --host-memory $budget --device-memory $budget "${street[@]}"
done
same whole-512MiB.png whole-1GiB.png
same street-512MiB.png street-1GiB.png
for run in 1 2 3; do timed "first picture, run $run" -o first.png --wait none; done

# Straight down on a street, from 70 m: with nothing known of chunks, and once all of it was seen. Another process each
# time: what was learned is kept in a folder of its own.
export LASRAY_CACHE=$folder/kept
down=(--eye 512000,5402960,270 --target 512000,5402960,200)
learning() {
    local name=$1
    shift
    /usr/bin/time -f "$name: %e s, %M KiB" "$lasray" render tiles --size 640x360 --quiet --json "$name.json" -o "$name.png" "$@"
}
read_in() { grep -o '"bytes_read": [0-9]*' "$1.json" | grep -o '[0-9]*$'; }
bytes_of() { du -sb "$1" | cut -f1; }
# at_most WHAT PART WHOLE TENTHS: whether it is at most so many tenths of a per cent.
at_most() {
    echo "$1: $2 of $3 bytes, $(awk "BEGIN { printf \"%.4f\", 100 * $2 / $3 }") %"
    [ $(($2 * 1000)) -le $(($3 * $4)) ] || { echo "$1: more than $4 tenths of a per cent" >&2; exit 1; }
}
learning unknown "${down[@]}"
learning all
learning known "${down[@]}"
same unknown.png known.png
data=$(bytes_of tiles)
echo "straight down, nothing known: $(read_in unknown) of $data bytes"
at_most "straight down, bounds of chunks known" "$(read_in known)" "$data" 50
at_most "what is kept" "$(bytes_of kept)" "$data" 1

# The same ground with a third and a tenth of the points: what is seen decides how much memory is used, not what there is.
# peak_of FOLDER ARGUMENT...: KiB, median of three.
peak_of() {
    local folder=$1
    shift
    for run in 1 2 3; do
        /usr/bin/time -o peak -f %M "$lasray" render "$folder" --cell 0.5 --size 640x360 --quiet --no-cache -o peak.png \
            --host-memory 512MiB --device-memory 512MiB "$@"
        cat peak
    done | sort -n | sed -n 2p
}
count=$(numfmt --from=si "$points")
"$lasray" synth third --points $((count / 3)) --density 2.6667 --tiles 8x8 ${suffix[@]+"${suffix[@]}"}
"$lasray" synth tenth --points $((count / 10)) --density 0.8 --tiles 8x8 ${suffix[@]+"${suffix[@]}"}
for view in whole street down; do
    at=()
    [ $view = street ] && at=("${street[@]}")
    [ $view = down ] && at=("${down[@]}")
    tenth=$(peak_of tenth ${at[@]+"${at[@]}"})
    for more in third tiles; do
        peak=$(peak_of $more ${at[@]+"${at[@]}"})
        echo "$view, peak memory, a tenth of the points and $more: $tenth and $peak KiB"
        [ $((peak * 10)) -le $((tenth * 11)) ] || { echo "$view: more than a tenth above" >&2; exit 1; }
    done
done
