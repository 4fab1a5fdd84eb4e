#!/usr/bin/env bash
# Packs every crate and compiles the files crate from what was packed, in an empty folder: what a crate needs and does
# not bring (a built-in scene, a readme that is a doctest, a licence) shows here and nowhere else. No network beyond what
# the build of the repository has fetched.
#
#     scripts/check_packages.sh [FOLDER]      keeps the compiled dependencies in FOLDER for the next time
set -euo pipefail
cd "$(dirname "$0")/.."

crates=(linalg tt ccp "" io view lab cli)
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cache=${1:-target/packages}
mkdir -p "$cache"
cache=$(cd "$cache" && pwd)

cargo package --workspace --allow-dirty --no-verify --offline --quiet --target-dir "$cache"

patches=()
for crate in "${crates[@]}"; do
    name=graintrain${crate:+-$crate}
    packed=$(find "$cache/package" -maxdepth 1 -name "$name-[0-9]*.crate" | sort -V | tail -1)
    tar -xzf "$packed" -C "$folder"
    unpacked=$folder/$(basename "$packed" .crate)
    for file in README.md LICENSE-MIT LICENSE-APACHE Cargo.toml; do
        [ -s "$unpacked/$file" ] || { echo "$name: $file is missing from the packed crate" >&2; exit 1; }
    done
    for key in description keywords categories license repository readme; do
        grep -q "^$key = " "$unpacked/Cargo.toml" || { echo "$name: no $key" >&2; exit 1; }
    done
    patches+=(--config "patch.crates-io.$name.path=\"$unpacked\"")
done

io=$(find "$folder" -maxdepth 1 -name 'graintrain-io-*')
cd "$io"
cargo check --quiet --offline --target-dir "$cache" "${patches[@]}" 2> "$folder/log" || { cat "$folder/log" >&2; exit 1; }
echo "${#crates[@]} crates are packed; graintrain-io compiles from its packed form"
