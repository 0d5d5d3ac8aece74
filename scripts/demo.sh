#!/usr/bin/env bash
# From nothing to a picture: sets up what is missing, builds, and renders a made-up town to demo.png.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/setup.sh

# shellcheck disable=SC2046 # one word a package
install $(missing_to_render)
install_rust
echo "building, which takes some minutes at first" >&2
cargo run --release --locked --quiet -- render --demo -o demo.png "$@"
echo "demo.png is ready"
