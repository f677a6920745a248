#!/usr/bin/env bash
# Prepares this machine for building, running and testing ibgs; `./setup.sh --help` says more.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

VULKAN_PACKAGES=(libvulkan1 mesa-vulkan-drivers)
# What the Python package is installed and tested with.
PYTHON_PACKAGES=(python3-venv python3-numpy python3-pil python3-pytest)
# Programs of `ibgs prepare`, each in the package of its name; none without --photos.
PHOTO_PROGRAMS=()

usage() {
    cat <<'END'
Usage: ./setup.sh [--photos]

Prepares this machine for building, running and testing ibgs: C and C++ compilers, Vulkan loader, a software
Vulkan driver, and what the Python package is installed and tested with.
It changes nothing when everything is there; run it as often as you like.

  --photos    also install COLMAP and ffmpeg, with which `ibgs prepare` makes scenes of photos and videos
  -h, --help  print this
END
}

say() {
    printf 'setup: %s\n' "$*"
}

fail() {
    printf 'setup: %s\n' "$*" >&2
    exit 1
}

# True when version $1 (MAJOR.MINOR...) is at least $2.
at_least() {
    local have_major have_minor need_major need_minor
    IFS=. read -r have_major have_minor _ <<<"$1."
    IFS=. read -r need_major need_minor _ <<<"$2."
    ((have_major > need_major || (have_major == need_major && have_minor >= need_minor)))
}

check_rust() {
    local needed version component
    needed=$(sed -n 's/^rust-version = "\([0-9.]*\)".*/\1/p' Cargo.toml | head -n 1)
    if ! command -v cargo >/dev/null; then
        fail "cargo was not found; install Rust $needed or later from https://rustup.rs, then open a new shell"
    fi
    version=$(cargo --version)
    version=${version#cargo }
    version=${version%% *}
    at_least "$version" "$needed" ||
        fail "Rust $version is too old, $needed is needed; run \`rustup update stable\`, or install it from https://rustup.rs"
    for component in fmt clippy; do
        cargo "$component" --version >/dev/null 2>&1 || add_component "$component"
    done
}

# Only the tests need these, so their absence is no failure here.
add_component() {
    local component=${1/fmt/rustfmt}
    say "adding the Rust component $component"
    if ! { command -v rustup >/dev/null && rustup component add "$component"; }; then
        say "could not add $component; .ci/check will not work until it is installed"
    fi
}

# Some dependencies compile C or C++ code; the linker is needed in any case.
has_compilers() {
    command -v cc >/dev/null && echo '#include <stdlib.h>' | cc -fsyntax-only -x c - 2>/dev/null &&
        command -v c++ >/dev/null && echo '#include <cmath>' | c++ -fsyntax-only -x c++ - 2>/dev/null
}

missing_packages() {
    local package status
    has_compilers || echo build-essential
    command -v pkg-config >/dev/null || echo pkg-config
    # One that was built here or comes from elsewhere is as good.
    for package in "${PHOTO_PROGRAMS[@]}"; do
        command -v "$package" >/dev/null || echo "$package"
    done
    for package in "${VULKAN_PACKAGES[@]}" "${PYTHON_PACKAGES[@]}"; do
        status=$(dpkg-query -W -f '${db:Status-Status}' "$package" 2>/dev/null) || status=absent
        [[ $status == installed ]] || printf '%s\n' "$package"
    done
}

setup_debian() {
    local missing
    mapfile -t missing < <(missing_packages)
    if ((${#missing[@]} == 0)); then
        return
    fi
    say "installing ${missing[*]}"
    local as_root=()
    if ((EUID != 0)); then
        if ! command -v sudo >/dev/null; then
            has_compilers && has_vulkan_loader && ((${#PHOTO_PROGRAMS[@]} == 0)) ||
                fail "not root and no sudo; as root, run: apt-get install ${missing[*]}"
            say "not root and no sudo, so ${missing[*]} stay missing; a compiler and a Vulkan loader are there"
            return
        fi
        as_root=(sudo)
    fi
    local apt=("${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get)
    "${apt[@]}" update || fail "apt-get update failed; see its messages above"
    "${apt[@]}" install -y --no-install-recommends "${missing[@]}" || fail "apt-get install failed; see its messages above"
}

has_vulkan_loader() {
    local ldconfig folder
    ldconfig=$(command -v ldconfig || command -v /sbin/ldconfig || true)
    if [[ -n $ldconfig ]] && "$ldconfig" -p 2>/dev/null | grep -F 'libvulkan.so.1' >/dev/null; then
        return 0
    fi
    for folder in /usr/lib /usr/lib64 /usr/local/lib /run/opengl-driver/lib; do
        [[ ! -e $folder/libvulkan.so.1 ]] || return 0
    done
    return 1
}

# Where this script installs nothing.
check_photo_programs() {
    # Old versions of bash take an empty list for one that is not set.
    ((${#PHOTO_PROGRAMS[@]} > 0)) || return 0
    local program
    for program in "${PHOTO_PROGRAMS[@]}"; do
        command -v "$program" >/dev/null || fail "$program was not found; install it: $1"
    done
}

check_other_unix() {
    say "this is not Debian or Ubuntu, so nothing is installed; ibgs needs a C and a C++ compiler, the Vulkan loader and a driver:"
    say "  Fedora:    dnf install gcc-c++ vulkan-loader mesa-vulkan-drivers vulkan-tools"
    say "  Arch:      pacman -S gcc vulkan-icd-loader vulkan-swrast vulkan-tools"
    has_compilers || fail "no working C and C++ compiler (cc, c++) was found; install them as listed above"
    has_vulkan_loader || fail "no Vulkan loader (libvulkan.so.1) was found; install it as listed above"
    check_photo_programs "with the package manager, or https://colmap.github.io and https://ffmpeg.org"
}

for argument in "$@"; do
    case "$argument" in
        --photos) PHOTO_PROGRAMS=(colmap ffmpeg) ;;
        -h | --help)
            usage
            exit
            ;;
        *) fail "unknown option $argument; see ./setup.sh --help" ;;
    esac
done

check_rust
case "$(uname -s)" in
    Darwin)
        # Metal is part of the system.
        has_compilers || fail "no working C and C++ compiler was found; run: xcode-select --install"
        check_photo_programs "brew install colmap ffmpeg"
        ;;
    MINGW* | MSYS* | CYGWIN*)
        say "Windows: DirectX 12 or the Vulkan driver of the GPU is used; building needs the Visual Studio C++ build tools"
        check_photo_programs "https://github.com/colmap/colmap/releases and https://ffmpeg.org/download.html"
        ;;
    *)
        if command -v apt-get >/dev/null && command -v dpkg-query >/dev/null; then
            setup_debian
        else
            check_other_unix
        fi
        ;;
esac
say "ready; \`cargo run --release info\` lists the adapters of this machine"
