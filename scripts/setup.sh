# Sourced by the other scripts: installs what a fresh machine lacks, and nothing where it is all there.
# shellcheck shell=bash

# Cargo may be installed without being on the path of this shell.
[ -d "$HOME/.cargo/bin" ] && PATH="$HOME/.cargo/bin:$PATH"
export PATH

# install PACKAGE...: by apt, as root; elsewhere says what is missing.
install() {
    [ $# -eq 0 ] && return
    if ! command -v apt-get >/dev/null; then
        echo "missing here (by their Debian names): $*. Install them and run this again." >&2
        return 1
    fi
    local root=()
    if [ "$(id -u)" -ne 0 ]; then
        if ! command -v sudo >/dev/null; then
            echo "run as root: apt-get install $*" >&2
            return 1
        fi
        root=(sudo)
    fi
    echo "installing $*"
    "${root[@]}" apt-get update -qq
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
}

# has_any FILE...: whether one of the files is there.
has_any() {
    local file
    for file in "$@"; do [ -e "$file" ] && return 0; done
    return 1
}

# Prints the packages that are missing to build and to render.
missing_to_render() {
    command -v cc >/dev/null || echo gcc libc6-dev
    command -v glslc >/dev/null || echo glslc
    if [ "$(uname)" = Linux ]; then
        has_any /usr/lib/*/libvulkan.so.1 /usr/lib/libvulkan.so.1 /usr/lib64/libvulkan.so.1 || echo libvulkan1
        has_any /usr/share/vulkan/icd.d/*.json /etc/vulkan/icd.d/*.json || echo mesa-vulkan-drivers
    fi
    has_new_cargo || command -v curl >/dev/null || echo curl ca-certificates
}

# Prints the packages that are missing to test: the reference driver, the validation layer, and for the window a display
# without a screen, what moves its mouse, and the libraries of X clients that are loaded at run time.
missing_to_test() {
    if [ "$(uname)" = Linux ]; then
        has_any /usr/share/vulkan/icd.d/lvp_icd*.json || echo mesa-vulkan-drivers
        has_any /usr/share/vulkan/explicit_layer.d/VkLayer_khronos_validation.json \
            /etc/vulkan/explicit_layer.d/VkLayer_khronos_validation.json || echo vulkan-validationlayers
        command -v Xvfb >/dev/null || echo xvfb
        command -v xdotool >/dev/null || echo xdotool
        local library
        for library in libx11-6:libX11.so.6 libx11-xcb1:libX11-xcb.so.1 libxcursor1:libXcursor.so.1 \
            libxi6:libXi.so.6 libxkbcommon-x11-0:libxkbcommon-x11.so.0; do
            has_any /usr/lib/*/"${library#*:}" /usr/lib/"${library#*:}" /usr/lib64/"${library#*:}" || echo "${library%:*}"
        done
    fi
}

# Whether cargo is there and not older than Cargo.toml's rust-version.
has_new_cargo() {
    local have want
    have=$(cargo --version 2>/dev/null | cut -d' ' -f2) || return 1
    [ -n "$have" ] || return 1
    want=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
    [ "$(printf '%s\n' "$want" "$have" | sort -V | head -1)" = "$want" ]
}

install_rust() {
    has_new_cargo && return
    echo "installing a Rust toolchain"
    curl --proto '=https' --tlsv1.2 -sSf https://sh.rustup.rs | sh -s -- -q -y --profile minimal --no-modify-path
    PATH="$HOME/.cargo/bin:$PATH"
    has_new_cargo || { echo "this needs a newer cargo than $(cargo --version)" >&2; return 1; }
}
