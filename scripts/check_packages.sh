#!/usr/bin/env bash
# Packs every crate and compiles the files crate from what was packed, in an empty folder: what a crate needs and does
# not bring (a built-in scene, a readme that is a doctest, a licence) shows here and nowhere else. No network beyond what
# the build of the repository has fetched, and no second build of dependencies: versions and profiles are the repository's.
set -euo pipefail
cd "$(dirname "$0")/.."

crates=(graintrain-{linalg,tt,ccp,io,view,lab,cli} graintrain)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
CARGO_TARGET_DIR=$(realpath -m "${CARGO_TARGET_DIR:-target}")
export CARGO_TARGET_DIR

cargo package --allow-dirty --no-verify --offline --quiet "${crates[@]/#/--package=}"

cp Cargo.lock "$folder"
{
    printf '[workspace]\nresolver = "3"\nmembers = ["graintrain*"]\n\n'
    sed -n '/^\[profile\./,$p' Cargo.toml
    printf '\n[patch.crates-io]\n'
} > "$folder/Cargo.toml"
for name in "${crates[@]}"; do
    packed=$(find "$CARGO_TARGET_DIR/package" -maxdepth 1 -name "$name-[0-9]*.crate" | sort -V | tail -1)
    tar -xzf "$packed" -C "$folder"
    unpacked=$folder/$(basename "$packed" .crate)
    for file in README.md LICENSE-MIT LICENSE-APACHE Cargo.toml; do
        [ -s "$unpacked/$file" ] || { echo "$name: $file is missing from the packed crate" >&2; exit 1; }
    done
    for key in description keywords categories license readme; do
        grep -q "^$key = " "$unpacked/Cargo.toml" || { echo "$name: no $key" >&2; exit 1; }
    done
    echo "$name.path = \"$(basename "$unpacked")\"" >> "$folder/Cargo.toml"
done

cd "$folder"
cargo check --quiet --offline -p graintrain-io 2> log || { cat log >&2; exit 1; }
echo "${#crates[@]} crates are packed; graintrain-io compiles from its packed form"
