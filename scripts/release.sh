#!/usr/bin/env bash
# What is too slow for every change, to be run before a release: the oldest Rust that is promised, each
# package built from what would be published, and the public interface against the one that is written down.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

step() { printf '\n==> %s\n' "$*"; }

oldest=$(sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
step "Rust $oldest"
rustup toolchain install "$oldest" --profile minimal --no-self-update
cargo "+$oldest" check --locked --workspace --exclude splitplane-viewer

step "each package, built from what would be published"
published=$(cargo metadata --locked --no-deps --format-version 1 |
    python3 -c 'import json, sys
for package in json.load(sys.stdin)["packages"]:
    if package["publish"] is None:
        print("-p", package["name"])')
# shellcheck disable=SC2086 # one word each
cargo package --locked $published

step "the public interface"
scripts/public_api.sh --check
