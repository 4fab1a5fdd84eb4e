#!/bin/sh
# Installs the program graintrain on Linux from a release: one file, no compiler, nothing beside it.
#
#     GRAINTRAIN_FROM=https://host/releases/v0.1.0 sh install.sh     from an address, or from a folder with the files of scripts/build_release.sh
#     GRAINTRAIN_TO=/usr/local/bin                                   where to (default ~/.local/bin)
set -eu

from=${GRAINTRAIN_FROM:-}
to=${GRAINTRAIN_TO:-$HOME/.local/bin}
if [ -z "$from" ]; then
    echo "install.sh: say where the release is: GRAINTRAIN_FROM=ADDRESS or FOLDER" >&2
    exit 1
fi
if [ "$(uname -s)" != Linux ]; then
    echo "install.sh: there are programs for Linux only: cargo install --path crates/graintrain-cli" >&2
    exit 1
fi
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

get() {
    case $from in
    http://* | https://*)
        if command -v curl > /dev/null; then curl -fsSL "$from/$1" -o "$work/$1"; else wget -q "$from/$1" -O "$work/$1"; fi
        ;;
    *) cp "$from/$1" "$work/$1" ;;
    esac
}

get SHA256SUMS
archive=$(sed -n "s/^[0-9a-f]*  \(graintrain-.*-linux-$(uname -m)\.tar\.gz\)\$/\1/p" "$work/SHA256SUMS" | head -n 1)
if [ -z "$archive" ]; then
    echo "install.sh: the release at $from has no program for $(uname -m)" >&2
    exit 1
fi
get "$archive"
(cd "$work" && grep -F "  $archive" SHA256SUMS | sha256sum -c - > /dev/null) || {
    echo "install.sh: $archive is not what SHA256SUMS says: it is not installed" >&2
    exit 1
}
tar -xzf "$work/$archive" -C "$work"
mkdir -p "$to"
# Beside it first: a program that runs is replaced, not written over.
cp "$work/${archive%.tar.gz}/graintrain" "$to/graintrain.new"
chmod 755 "$to/graintrain.new"
mv "$to/graintrain.new" "$to/graintrain"
"$to/graintrain" --version
case ":$PATH:" in
*":$to:"*) ;;
*) echo "$to is not on your PATH: add it, or call $to/graintrain" ;;
esac
