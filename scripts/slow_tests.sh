#!/usr/bin/env bash
# Runs the tests that `cargo test` leaves out because they take minutes, optimised; arguments go to cargo (-p CRATE, a name).
#
#     scripts/slow_tests.sh                    all of them
#     scripts/slow_tests.sh -p graintrain-ccp
#     scripts/slow_tests.sh --list             what there is, and why it is left out
set -euo pipefail
cd "$(dirname "$0")/.."

if [ "${1:-}" = --list ]; then
    grep -rn --include='*.rs' -A 2 '#\[ignore = ' crates |
        sed -nE 's|^crates/([^/]*)/([^:]*):[0-9]+:#\[ignore = "(.*)"\]|\1 \2: \3|p; s|^.*-[0-9]+-fn ([a-z0-9_]*).*|    \1|p'
    exit
fi
if [ $# = 0 ]; then
    set -- --workspace
fi
cargo test --release --locked --no-fail-fast "$@" -- --ignored
