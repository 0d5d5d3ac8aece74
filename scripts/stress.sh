#!/usr/bin/env bash
# What takes long: the camera's jumps and the window's resizes by the thousand, under the validation layers.
# JUMPS (10000), RESIZES (500). docs/large.md says what it gave.
set -euo pipefail
cd "$(dirname "$0")/.."
export LASRAY_JUMPS=${JUMPS:-10000} LASRAY_RESIZES=${RESIZES:-500}
cargo test --release --locked --test devices jumps_neither_leak_nor_wait -- --nocapture
cargo test --release --locked --test window resize -- --nocapture
