#!/usr/bin/env bash
# pack.sh [FOLDER]: packs what a bare x86-64 Linux machine with a GPU's driver, and nothing else, needs to run lasray, its
# benchmarks and its tests on that GPU. Run it on Debian or Ubuntu; copy FOLDER (default target/gpu, some 25 MB) there and
# start FOLDER/run.sh, for which `trace` is the laboratory of benches/trace.rs. TESTS: names of test binaries (default: those that use a device).
set -euo pipefail
cd "$(dirname "$0")/../.."
out=${1:-target/gpu}
tests=${TESTS:-device devices ordering exact}
rm -rf "$out"; mkdir -p "$out"; out=$(cd "$out" && pwd)
stage=$(mktemp -d); trap 'rm -rf "$stage"' EXIT
root=$stage/root; own=$root/opt/lasray
mkdir -p "$own/lib" "$own/layer" "$stage/debs"

# The Vulkan loader, and libraries that drivers of graphics cards are linked with; of the browser, its validation layer,
# which sees more than Debian's.
(
    cd "$stage/debs"
    apt-get -qq download libvulkan1 libegl1 libglvnd0 libopengl0 libgl1 libglx0 libgles2 libx11-6 libxext6 libxcb1 \
        libxau6 libxdmcp6 libbsd0 libmd0 chromium-common 2>/dev/null
    for deb in *.deb; do dpkg -x "$deb" .; done
    find . -name '*.so*' -path '*-linux-gnu/*' -exec cp -a {} "$own/lib/" \;
    cp usr/lib/chromium/libVkLayer_khronos_validation.so "$own/layer/"
)
cat >"$own/layer/layer.json" <<'JSON'
{"file_format_version": "1.2.0", "layer": {"name": "VK_LAYER_KHRONOS_validation", "type": "GLOBAL",
 "library_path": "./libVkLayer_khronos_validation.so", "api_version": "1.3.290", "implementation_version": "1",
 "description": "validation", "instance_extensions": [
 {"name": "VK_EXT_debug_utils", "spec_version": "1"}, {"name": "VK_EXT_validation_features", "spec_version": "2"}]}}
JSON

cargo build --release --locked --quiet
target=$(cargo metadata --format-version 1 --no-deps | python3 -c 'import json, sys; print(json.load(sys.stdin)["target_directory"])')
cp "$target/release/lasray" "$own/"
cp "$(cargo bench --locked --no-run --bench trace --message-format=json 2>/dev/null | python3 -c '
import json, sys
print(next(m["executable"] for m in map(json.loads, sys.stdin)
           if m.get("reason") == "compiler-artifact" and m["target"]["name"] == "trace"))')" "$own/trace"

# Tests find the program, their libraries and their temporary folder by the absolute paths that they were built at.
mapfile -t built < <(cargo test --workspace --locked --no-run --message-format=json 2>/dev/null | python3 -c '
import json, sys
for m in map(json.loads, sys.stdin):
    if m.get("reason") == "compiler-artifact" and m.get("executable") and m["profile"]["test"] \
            and m["target"]["name"] in sys.argv[1].split():
        print(m["target"]["name"], m["executable"])' "$tests")
mkdir -p "$root$target/debug/deps" "$root$target/tmp"
cp "$target/debug/lasray" "$root$target/debug/"
cp "$target"/debug/deps/lib{two_queues,failing_disk}.so "$root$target/debug/deps/"
printf '%s\n' "${built[@]}" | while read -r name path; do
    cp "$path" "$root$path"
    echo "$name $path" >>"$out/tests"
done
find "$root" -type f -exec strip {} + 2>/dev/null || true
tar -C "$root" -cf - . | xz -T2 -3 >"$out/root.tar.xz"
cp scripts/gpu/run.sh "$out/"
du -sh "$out"
