#!/usr/bin/env bash
# Builds the viewer's module for browsers; `build.sh --help` says more.
set -euo pipefail
CALLED_FROM=$PWD
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

TARGET=wasm32-unknown-unknown
BUILDS=${CARGO_TARGET_DIR:-target}
FOLDER=$BUILDS/release/web

usage() {
    cat <<'END'
Usage: crates/ibgs-web/build.sh [FOLDER]

Builds the viewer's module for browsers, which `ibgs export --web` puts into a page, into FOLDER, by
default target/release/web, where the program looks for it. Brings what it needs and is not there:
Rust's target wasm32-unknown-unknown, by rustup, and the program wasm-bindgen in the version of
Cargo.lock, built into target/wasm-bindgen. About 15 minutes on two cores, at the first time.
END
}

say() {
    printf 'build.sh: %s\n' "$*"
}

fail() {
    printf 'build.sh: %s\n' "$*" >&2
    exit 1
}

has_target() {
    [[ -d $(rustc --print sysroot)/lib/rustlib/$TARGET ]]
}

add_target() {
    has_target && return
    say "adding Rust's target $TARGET"
    { command -v rustup >/dev/null && rustup target add "$TARGET"; } ||
        fail "Rust's target $TARGET is missing and could not be added; run \`rustup target add $TARGET\`"
}

# Prints the path of the program, in version $1.
bindgen() {
    local program
    for program in wasm-bindgen "$BUILDS/wasm-bindgen/bin/wasm-bindgen"; do
        if [[ $("$program" --version 2>/dev/null) == "wasm-bindgen $1" ]]; then
            echo "$program"
            return
        fi
    done
    say "building wasm-bindgen $1, the version of Cargo.lock" >&2
    # A mirror of crates.io may lack a version that the program's own lock file names.
    local install=(cargo install wasm-bindgen-cli --version "$1" --root "$BUILDS/wasm-bindgen")
    "${install[@]}" --locked >&2 || "${install[@]}" >&2 ||
        fail "wasm-bindgen $1 could not be built; run \`cargo install wasm-bindgen-cli --version $1\`"
    echo "$BUILDS/wasm-bindgen/bin/wasm-bindgen"
}

case "${1:-}" in
    -h | --help)
        usage
        exit
        ;;
    -*) fail "unknown option $1; see --help" ;;
    '') ;;
    /*) FOLDER=$1 ;;
    *) FOLDER=$CALLED_FROM/$1 ;;
esac
(($# <= 1)) || fail "one folder is enough; see --help"

add_target
version=$(awk '$0 == "name = \"wasm-bindgen\"" { getline; gsub(/[^0-9.]/, ""); print; exit }' Cargo.lock)
program=$(bindgen "$version")
cargo build --release --locked -p ibgs-web --target "$TARGET"
"$program" --target web --out-dir "$FOLDER" "$BUILDS/$TARGET/release/ibgs_web.wasm"
say "$FOLDER is ready for \`ibgs export --web\`"
