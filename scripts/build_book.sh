#!/usr/bin/env bash
# Builds the book of docs/book into target/book. Its commands and links are checked by
# `cargo test -p graintrain-cli --test all book`, which needs no mdbook.
set -euo pipefail
cd "$(dirname "$0")/.."

if ! command -v mdbook > /dev/null; then
    echo "mdbook is not on the PATH: cargo install mdbook (0.4 or 0.5), or https://github.com/rust-lang/mdBook/releases" >&2
    exit 1
fi
mdbook build docs/book
# The pages of the notebook are included from docs/, their pictures lie beside them there.
cp docs/*.svg docs/*.toml target/book/notebook/
# Pages link to sources from where they lie in docs/book/src. In the built book these links lead to the repository around it, or to
# BOOK_SOURCES=https://host/graintrain/blob/main where it is shown elsewhere.
sources=${BOOK_SOURCES:-../..}
sed -i.bak -E "s#href=\"\.\./\.\./\.\./([A-Z]+)\.html#href=\"$sources/\1.md#g; s#href=\"\.\./\.\./\.\./#href=\"$sources/#g" target/book/*.html
rm target/book/*.html.bak
echo "target/book/index.html"
