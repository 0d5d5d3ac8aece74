#!/usr/bin/env bash
# Sets up what is missing and runs every test. Arguments go to `cargo test`.
#
# Debian's `chromium` brings the second driver (SwiftShader) and a validation layer that sees more than
# Debian's own; it is large, so it is installed in CI only (CI set), and used where it is there.
set -euo pipefail
cd "$(dirname "$0")/.."
. scripts/setup.sh

browser=()
if ! has_any /usr/lib/chromium/libvk_swiftshader.so; then
    if [ -n "${CI:-}" ]; then
        browser=(chromium)
    else
        echo "package chromium is not installed: no tests on SwiftShader, none of synchronization validation"
    fi
fi
# shellcheck disable=SC2046 # one word a package
install $( (missing_to_render; missing_to_test) | tr ' ' '\n' | sort -u) ${browser[@]+"${browser[@]}"}
install_rust
cargo test --workspace --locked --no-fail-fast "$@"
