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
    /usr/bin/time -f "$name: %e s, %M KiB" "$lasray" render tiles --size 640x360 --quiet "$@"
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

# All of it, then straight down on a street: what is read for that, once the bounds of chunks are known.
cat > down.json <<'JSON'
{"version": 1, "keyframes": [
 {"time": 0, "eye": [512000, 5400000, 4000], "target": [512000, 5402960, 200]},
 {"time": 0.2, "eye": [512000, 5402960, 270], "target": [512000, 5402960, 200]},
 {"time": 0.4, "eye": [512000, 5402960, 270], "target": [512000, 5402960, 200]},
 {"time": 1, "eye": [512000, 5402960, 270], "target": [512000, 5402960, 200]}]}
JSON
timed "whole, then a street" --path down.json --frames 2 -o "%d.png" --json read.json
grep -o '"bytes_read": [0-9]*' read.json
du -sb tiles
