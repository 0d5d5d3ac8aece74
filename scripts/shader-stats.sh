#!/usr/bin/env bash
# What the compiler of AMD chips that need not be there makes of every pass: registers, spills, subgroups a SIMD,
# instructions, branches, bytes. Mesa's RADV compiles for any family on "null hardware"; nothing runs.
# Debian, Ubuntu: apt install mesa-vulkan-drivers.
#   scripts/shader-stats.sh [--json FOLDER] [FAMILY...]     (default NAVI21; NAVI10, VEGA10, ...)
set -euo pipefail
folder=
if [ "${1:-}" = --json ]; then
    folder=$(realpath "$2")
    shift 2
fi
cd "$(dirname "$0")/.."
icd=${RADV_ICD:-$(ls /usr/share/vulkan/icd.d/radeon_icd.*json 2>/dev/null | head -n 1 || true)}
if [ -z "$icd" ]; then
    echo "shader-stats.sh: no RADV driver in /usr/share/vulkan/icd.d: install mesa-vulkan-drivers, or set RADV_ICD" >&2
    exit 1
fi
for family in "${@:-NAVI21}"; do
    RADV_FORCE_FAMILY=$family VK_ICD_FILENAMES=$icd VK_DRIVER_FILES=$icd \
        cargo bench --quiet --bench trace -- --statistics ${folder:+--json "$folder/$family.json"}
done
