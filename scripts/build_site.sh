#!/usr/bin/env bash
# Builds site/: front page and gallery, the playground (the program in a browser), the book, the documentation of the Rust crates.
# Any web server shows it: python3 -m http.server -d site
#
#     scripts/build_site.sh               all of it
#     scripts/build_site.sh playground    the playground alone
#
# Needs Node.js >= 20 with npm, the Rust target wasm32-wasip1 (rustup target add wasm32-wasip1; or WASM=FILE, a program compiled elsewhere),
# and mdbook for the book.
set -euo pipefail
cd "$(dirname "$0")/.."

export CARGO_INCREMENTAL=0
program=${GRAINTRAIN:-target/release/graintrain}
if [ -z "${GRAINTRAIN:-}" ]; then
    cargo build --release --locked -p graintrain-cli
fi
if [ -z "${WASM:-}" ]; then
    if [ ! -d "$(rustc --print sysroot)/lib/rustlib/wasm32-wasip1" ]; then
        echo "the Rust target wasm32-wasip1 is not installed: rustup target add wasm32-wasip1" >&2
        exit 1
    fi
    RUSTFLAGS="-C target-feature=+simd128" cargo build --profile dist --locked --target wasm32-wasip1 -p graintrain-cli
    WASM=target/wasm32-wasip1/dist/graintrain.wasm
fi

mkdir -p site/playground
(cd playground && npm ci --silent && npm run --silent build)
cp playground/index.html playground/style.css site/playground/
cp "$WASM" site/playground/graintrain.wasm
"$program" schema > site/playground/graintrain.schema.json
echo "site/playground/index.html"
if [ "${1:-}" = playground ]; then
    exit
fi

cp playground/front.css site/
# The examples of the Python package as notebooks with their outputs, where PYTHON has the package and Jupyter.
python=${PYTHON:-python3}
if "$python" -c 'import graintrain, ipykernel, nbclient, nbconvert' 2> /dev/null; then
    examples=crates/graintrain-python/examples
    "$python" crates/graintrain-python/tests/make_notebook.py $examples/*.py site/notebooks
    cp $examples/*.ipynb site/notebooks/
else
    echo "no notebooks: PYTHON=$python has not all of graintrain, ipykernel, nbclient, nbconvert" >&2
fi
node playground/site.mjs "$program" site
# Pages of the book link to sources: to those at BOOK_SOURCES, or to a copy.
if [ -z "${BOOK_SOURCES:-}" ]; then
    mkdir -p site/source
    git archive HEAD | tar -x -C site/source
    export BOOK_SOURCES=../source
fi
scripts/build_book.sh
rm -rf site/book site/api
cp -r target/book site/book
cargo doc --workspace --no-deps --locked
cp -r target/doc site/api
echo "site/index.html"
