#!/usr/bin/env bash
# The recorded QPs, solved by our solver and by its peers from PyPI in one run: peers.sh [ROUNDS]
# Installs the peers into a Python environment under target/; RUSTFLAGS is yours to set.
set -euo pipefail

cd "$(dirname "$(realpath "${BASH_SOURCE[0]}")")"
target=$(cargo metadata --no-deps --format-version 1 |
    sed 's/.*"target_directory":"\([^"]*\)".*/\1/')
venv=$target/peers-venv
if ! cmp --silent peers/requirements.txt "$venv/made-from"; then
    python3 -m venv "$venv"
    "$venv/bin/pip" install --quiet --requirement peers/requirements.txt
    cp peers/requirements.txt "$venv/made-from"
fi
library=$(cargo build --release --locked --package law --example peers --message-format=json |
    sed -n 's/.*"kind":\["example"\].*"filenames":\["\([^"]*\)".*/\1/p')
OMP_NUM_THREADS=1 "$venv/bin/python" peers/peers.py "$library" \
    ../tests/data/obstacle_avoidance.qps "${1:-5}"
