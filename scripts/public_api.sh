#!/usr/bin/env bash
# Lists the public interface of the crates that embedders use, one line an item, in docs/api.
#
#     scripts/public_api.sh            writes the lists
#     scripts/public_api.sh --check    fails where a list is not what is written down
#
# Needs cargo-public-api and a nightly toolchain, whose rustdoc tells it what is there; installs them.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

rustup toolchain install nightly --profile minimal --no-self-update
cargo public-api --version >/dev/null 2>&1 || cargo install --locked cargo-public-api

lists=docs/api
[ "${1:-}" != --check ] || lists=$(mktemp -d)
mkdir -p "$lists"
for package in splitplane splitplane-core splitplane-cpu splitplane-wgpu splitplane-render \
    splitplane-scene splitplane-verify splitplane-shaders; do
    cargo +nightly public-api -p "$package" --all-features -sss >"$lists/$package.txt"
done
wc -l "$lists"/*.txt
[ "${1:-}" != --check ] || diff -ru docs/api "$lists"
