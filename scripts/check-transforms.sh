#!/usr/bin/env bash
# Compares transformed coordinates with those of PROJ's cs2cs, which it installs (Debian: proj-bin).
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/setup.sh

missing=()
command -v cs2cs >/dev/null || missing=(proj-bin)
# shellcheck disable=SC2046 # one word a package
install $(missing_to_render | tr ' ' '\n' | sort -u) ${missing[@]+"${missing[@]}"}
install_rust
LASRAY_CS2CS=1 cargo test --locked --test sources -- cs2cs --nocapture
