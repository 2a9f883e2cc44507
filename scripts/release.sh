#!/usr/bin/env bash
# What is too slow for every change, to be run before a release: the oldest Rust that is promised, each package built from what would be
# published, and the long forms of tests, which take half an hour of processor time or more.
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

step "long tests: ten million rays of random scenes, a million sequences of edits, and others that are named in the sources by SPLITPLANE_LONG"
export SPLITPLANE_LONG=1
cargo test --locked -p splitplane-cpu --test suite -- baked_in_f64:: baked:: instances:: scene_closest_points::
cargo test --locked -p splitplane-fuzz-targets --test suite corpus::
cargo test --locked -p splitplane-wgpu --test suite -- resident:: lists:: halves::
cargo test --locked --features scene --test suite -- hits:: extremes:: best::
