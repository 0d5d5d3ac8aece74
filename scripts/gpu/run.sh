#!/usr/bin/env bash
# run.sh [tests] [-- COMMAND]: on the machine with the GPU, as root. Unpacks what pack.sh packed (into /opt/lasray, and the
# tests where they were built), shows the devices, runs the tests on the GPU, then COMMAND, a shell line that finds `lasray` and `trace`:
#
#   bash run.sh tests -- 'lasray bench --json bench.json'
#
# The GPU's driver is the first that is no software driver, or the one whose manifest LASRAY_TEST_ICD names. Logs go to
# $OUT (default: the current folder). Returns 1 where a test failed, 3 where there is no device.
set -u
here=$(cd "$(dirname "$0")" && pwd)
OUT=${OUT:-.}
tar --no-same-owner -xJf "$here/root.tar.xz" -C / --no-overwrite-dir || exit 3
export PATH=/opt/lasray:$PATH LD_LIBRARY_PATH=/opt/lasray/lib${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}
export LASRAY_VALIDATION_LAYER_DIR=/opt/lasray/layer
if [ -z "${LASRAY_TEST_ICD:-}" ]; then
    LASRAY_TEST_ICD=$(find /usr/share/vulkan/icd.d /usr/local/share/vulkan/icd.d /etc/vulkan/icd.d /usr/local/nvidia \
        -path '*icd.d/*.json' ! -name 'lvp*' 2>/dev/null | sort | head -n 1)
fi
[ -n "$LASRAY_TEST_ICD" ] || { echo "no driver's manifest found: set LASRAY_TEST_ICD" >&2; exit 3; }
export LASRAY_TEST_ICD VK_DRIVER_FILES=$LASRAY_TEST_ICD VK_ICD_FILENAMES=$LASRAY_TEST_ICD
echo "driver: $LASRAY_TEST_ICD"
lasray info --devices || exit 3
failed=0
if [ "${1:-}" = tests ]; then
    shift
    while read -r name path; do
        timeout "${TEST_S:-300}" "$path" --test-threads "${THREADS:-6}" >"$OUT/$name.log" 2>&1 || failed=1
        echo "$name: $(grep -E '^test result' "$OUT/$name.log" | tail -n 1)"
        grep -E '^test .* FAILED' "$OUT/$name.log" | sort -u
    done <"$here/tests"
fi
[ "${1:-}" = -- ] && shift
[ $# -eq 0 ] || bash -c "$*" || failed=1
exit $failed
