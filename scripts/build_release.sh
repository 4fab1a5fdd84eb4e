#!/usr/bin/env bash
# Builds what is handed out, into dist/: the program for Linux as one static file (nothing to install beside it), wheels of the Python package for
# manylinux2014 (any CPython from 3.10 on), and checksums.
#
#     scripts/build_release.sh                                  for this machine's processor
#     scripts/build_release.sh x86_64 aarch64                   for these; another than this machine's needs its Rust target and C compiler
#     scripts/build_release.sh program x86_64                   programs alone; `wheel` wheels alone
#
# Needs python3 with pip and venv for the wheels (maturin and zig come from the index of Python packages), Debian's gcc-aarch64-linux-gnu or the like to cross.
set -euo pipefail
cd "$(dirname "$0")/.."

export CARGO_INCREMENTAL=0
what=all
case "${1:-}" in program | wheel) what=$1; shift ;; esac
if [ $# = 0 ]; then
    set -- "$(uname -m)"
fi
version=$(sed -n 's/^version = "\(.*\)"$/\1/p' Cargo.toml | head -1)
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")
mkdir -p dist

program() {
    local triple=$1-unknown-linux-gnu name=graintrain-$version-linux-$1 folder
    if [ "$1" != "$(uname -m)" ]; then
        local linker=CARGO_TARGET_$(tr a-z- A-Z_ <<< "$triple")_LINKER
        export "$linker=$1-linux-gnu-gcc" "CC_${triple//-/_}=$1-linux-gnu-gcc"
    fi
    # The C library is linked in: the program runs on any Linux, in an empty container, too.
    RUSTFLAGS="-C target-feature=+crt-static" cargo build --profile dist --locked --target "$triple" -p graintrain-cli
    folder=$(mktemp -d)
    mkdir "$folder/$name"
    cp "$target/$triple/dist/graintrain" README.md CHANGELOG.md LICENSE-MIT LICENSE-APACHE "$folder/$name/"
    tar -C "$folder" --owner=0 --group=0 --numeric-owner --sort=name -czf "dist/$name.tar.gz" "$name"
    # For the Dockerfile.
    mkdir -p "dist/linux-$1"
    cp "$target/$triple/dist/graintrain" "dist/linux-$1/"
    rm -rf "$folder"
    echo "dist/$name.tar.gz"
}

wheel() {
    if [ ! -x "$target/release-tools/bin/maturin" ]; then
        python3 -m venv "$target/release-tools"
        "$target/release-tools/bin/python" -m pip install --quiet --disable-pip-version-check "maturin>=1.7,<2" ziglang
    fi
    PATH=$target/release-tools/bin:$PATH maturin build --profile wheel --locked --quiet --zig --compatibility manylinux2014 \
        --target "$1-unknown-linux-gnu" --out dist
}

for processor in "$@"; do
    if [ "$what" != wheel ]; then program "$processor"; fi
    if [ "$what" != program ]; then wheel "$processor"; fi
done
(cd dist && find . -maxdepth 1 -type f ! -name SHA256SUMS -printf '%P\n' | sort | xargs sha256sum > SHA256SUMS)
cat dist/SHA256SUMS
