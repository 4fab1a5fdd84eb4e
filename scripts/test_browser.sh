#!/usr/bin/env bash
# Builds the playground and tests it: the program of the page has the bits and the words of the program of this machine, and the page does what it
# says in headless Chromium (CHROMIUM, by default /usr/bin/chromium; its tests say that they are skipped where there is none).
# Needs what scripts/build_site.sh needs, but for mdbook.
set -euo pipefail
cd "$(dirname "$0")/.."

if [ -z "${GRAINTRAIN:-}" ]; then
    cargo build --release --locked -p graintrain-cli
    GRAINTRAIN=$PWD/target/release/graintrain
fi
export GRAINTRAIN
scripts/build_site.sh playground
cd playground
npm test --silent
