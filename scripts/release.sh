#!/usr/bin/env bash
# What is too slow for every change, to be run before a release: the oldest Rust that is promised, and each
# package built from what would be published.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

step() { printf '\n==> %s\n' "$*"; }

oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
step "Rust $oldest"
rustup toolchain install "$oldest" --profile minimal --no-self-update
cargo "+$oldest" check --locked --workspace --exclude splitplane-viewer

step "each package, built from what would be published"
published=$(scripts/published.py)
# shellcheck disable=SC2086 # one word each
cargo package --locked $published
