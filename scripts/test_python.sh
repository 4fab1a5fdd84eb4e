#!/usr/bin/env bash
# Builds the wheel of the Python package, installs it into a fresh virtual environment and runs its tests in an empty folder, away from
# the Rust sources. Needs python3 >= 3.10 with pip and venv, and the index of Python packages (or PIP_INDEX_URL, PIP_FIND_LINKS).
#
#     scripts/test_python.sh [ARGUMENTS of pytest]
set -euo pipefail
cd "$(dirname "$0")/.."

folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT

python3 -m venv "$folder/venv"
pip=("$folder/venv/bin/python" -m pip --quiet --disable-pip-version-check)
"${pip[@]}" install "maturin>=1.7,<2"
# In the profile and with the features of the tests, so that it takes what was compiled for them.
"$folder/venv/bin/maturin" build --features as-tested --locked --quiet --interpreter "$folder/venv/bin/python" --out "$folder/wheel"
"${pip[@]}" install "$(echo "$folder"/wheel/graintrain-*.whl)[test]"

mkdir "$folder/away"
cp -r crates/graintrain-python/tests crates/graintrain-python/examples "$folder/away"
cd "$folder/away"
MPLBACKEND=Agg "$folder/venv/bin/python" -m pytest -q -p no:cacheprovider tests "$@"
