#!/usr/bin/env bash
# What takes long: jumps of the camera by the thousand, under the validation layers.
# JUMPS (10000). docs/large.md says what it gave.
set -euo pipefail
cd "$(dirname "$0")/.."
LASRAY_JUMPS=${JUMPS:-10000} cargo test --release --locked --test devices jumps_neither_leak_nor_wait -- --nocapture
