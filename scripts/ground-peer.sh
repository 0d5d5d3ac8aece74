#!/usr/bin/env bash
# The ground filter beside pysmrf (PyPI), with the same parameters, on files whose classes 2, 9, 10, 11 and 41 are the true ground: metres, LAS or LAZ.
#
#   scripts/ground-peer.sh FILE…
#
# pysmrf goes into a virtual environment in a temporary folder, which is removed at the end.
set -euo pipefail
if [ $# = 0 ]; then
    echo "usage: $0 FILE…" >&2
    exit 2
fi
here=$(cd "$(dirname "$0")/.." && pwd)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q --disable-pip-version-check pysmrf laspy lazrs
"$folder/venv/bin/python" - "$@" <<'PYTHON'
import sys, time
import laspy, numpy
from pysmrf import classify

print(f"{'pysmrf, errors, %':<36}{'points':>11}{'ground':>11}{'total':>11}{'type I':>11}{'type II':>11}{'s':>11}")
totals = []
for name in sys.argv[1:]:
    file = laspy.read(name)
    classes = numpy.asarray(file.classification)
    part = ~numpy.isin(classes, (7, 18)) & (numpy.asarray(file.withheld) == 0)
    x, y, z = (numpy.asarray(axis)[part] for axis in (file.x, file.y, file.z))
    truth = numpy.isin(classes[part], (2, 9, 10, 11, 41))
    start = time.perf_counter()
    told = classify(x, y, z, cellsize=1.0, windows=18, slope_threshold=0.15, elevation_threshold=0.5,
                    elevation_scaler=1.25, low_filter_slope=5.0, low_outlier_fill=True).is_ground
    took = time.perf_counter() - start
    share = lambda wrong: 100 * wrong.mean() if wrong.size else float("nan")
    errors = share(told != truth), share(~told[truth]), share(told[~truth])
    totals.append(errors[0])
    row = "".join(f"{v:>11.2f}" for v in (share(truth), *errors, took))
    print(f"{name[-35:]:<36}{truth.size:>11}{row}")
print(f"{'mean of the files':<58}{sum(totals) / len(totals):>11.2f}")
PYTHON
cargo build --manifest-path "$here/Cargo.toml" --release --locked --quiet
"$here/target/release/lasray" bench --complete --truth --quiet "$@"
