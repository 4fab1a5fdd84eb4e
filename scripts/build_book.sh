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
cp docs/*.svg docs/*.toml docs/*.csv target/book/notebook/
# Pages link to sources from where they lie in docs/book/src. In the built book these links lead to the repository around it, or to
# BOOK_SOURCES=https://host/graintrain/blob/main where it is shown elsewhere.
sources=${BOOK_SOURCES:-../..}
# A page of the notebook stands in docs/ itself, one folder deeper in the book; one page for printing has them all.
of_pages="s#href=\"\.\./\.\./\.\./([A-Z]+)\.html#href=\"$sources/\1.md#g; s#href=\"\.\./\.\./\.\./#href=\"$sources/#g"
deeper=$sources
case $sources in *://*) ;; *) deeper=../$sources ;; esac
of_notebook="s#href=\"\.\./\.\./\.\./([a-z]+\.csv)#href=\"\1#g; s#href=\"\.\./([A-Z]+)\.html#href=\"$deeper/\1.md#g; s#href=\"\.\./(crates|scripts)/#href=\"$deeper/\1/#g"
sed -i.bak -E "$of_pages" target/book/*.html
sed -i.bak -E "s#href=\"([A-Z]+)\.html#href=\"$sources/\1.md#g; s#href=\"(crates|scripts)/#href=\"$sources/\1/#g; s#href=\"(\.\./\.\./)?([a-z]+\.csv)#href=\"notebook/\2#g" target/book/print.html
sed -i.bak -E "$of_notebook" target/book/notebook/*.html
rm target/book/*.html.bak target/book/notebook/*.html.bak
echo "target/book/index.html"
