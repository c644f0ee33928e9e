# Sourced by scripts that compile for another target than this computer. Three ways, the first that is there:
#   1. rustup with the target
#   2. Debian's packages cargo-web, rustc-web, rust-web-src and lld, which compile the standard library from source
#   3. rustup without the target, which it then fetches

has_rustup_target() {
    command -v rustc >/dev/null &&
        compgen -G "$(rustc --print sysroot)/lib/rustlib/$1/lib/libcore-*.rlib" >/dev/null
}

has_debian_rust() {
    [ -x /usr/bin/cargo ] && [ -x /usr/bin/rustc ] &&
        [ -e "$(/usr/bin/rustc --print sysroot)/lib/rustlib/src/rust/library/core" ]
}

# choose_cargo TARGET LIBRARIES: sets `cargo`, the command, and `target_options`; LIBRARIES are those of the standard library
# that TARGET needs. Fails if there is no compiler.
choose_cargo() {
    local wrapper=RUSTC_WRAPPER=$PWD/scripts/rustc-without-places folder
    # Absolute, because cargo starts the compiler in several folders.
    folder=$(realpath -m "${CARGO_TARGET_DIR:-target}")
    target_options=(--target "$1")
    if has_rustup_target "$1"; then
        echo "building for $1 with $(rustc --version)"
        cargo=(env "$wrapper" CARGO_TARGET_DIR="$folder" cargo)
    elif has_debian_rust; then
        echo "building for $1 with Debian's $(/usr/bin/rustc --version), $2 from source"
        # -Zbuild-std is a nightly option; RUSTC_BOOTSTRAP lets this stable compiler take it.
        # Its own directory under target/: two compilers in one would rebuild each other's work.
        cargo=(env "$wrapper" CARGO_TARGET_DIR="$folder/build-std" RUSTC=/usr/bin/rustc RUSTC_BOOTSTRAP=1 /usr/bin/cargo)
        target_options+=("-Zbuild-std=$2")
    elif command -v rustup >/dev/null && rustup target add "$1" && has_rustup_target "$1"; then
        choose_cargo "$@"
    else
        echo "no compiler for $1. Install rustup (https://rustup.rs), or on Debian:
apt-get update && apt-get install cargo-web rustc-web rust-web-src lld" >&2
        return 1
    fi
}

# find_lld NAME: rust-lld of a rustup toolchain, else the linker NAME.
find_lld() {
    local lld
    if command -v rustc >/dev/null; then
        for lld in "$(rustc --print sysroot)"/lib/rustlib/*/bin/rust-lld; do
            [ -x "$lld" ] && { echo "$lld"; return; }
        done
    fi
    for lld in "$1" rust-lld; do command -v "$lld" && return; done
    echo "no linker: neither rust-lld nor $1 is installed; on Debian: apt-get update && apt-get install lld" >&2
    return 1
}

# Sets AUTOSWING_VERSION, which the programs print in place of the package's version: with the commit, and `-dirty` if a file
# differs from it. Without git it stays unset, and a value from outside stays.
export_version() {
    local version commit
    [ -z "${AUTOSWING_VERSION:-}" ] || return 0
    version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
    commit=$(git describe --always --exclude='*' --abbrev=10 --dirty 2>/dev/null) || return 0
    export AUTOSWING_VERSION="$version ($commit)"
}
