#!/usr/bin/env bash
# All checks that read the code and run no test of it: format, clippy, documentation, features,
# dependencies, links, packages.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT

step() { printf '\n==> %s\n' "$*"; }
fail() {
    printf 'FAILED: %s\n' "$*" >&2
    exit 1
}
# Packages that a build of the given package with the given flags compiles, by name.
packages() {
    cargo tree --locked -e normal,build --prefix none --format '{p}' "$@" |
        cut -d' ' -f1 | sort -u
}

step "cargo fmt"
cargo fmt --all --check

# The viewer is in no default build; nothing of the others is left out when it is in.
step "cargo clippy"
cargo clippy --locked --workspace --features splitplane-cli/measure,splitplane-cli/viewer --all-targets -- -D warnings

step "cargo doc"
RUSTDOCFLAGS="-D warnings" cargo doc --locked --workspace --features splitplane-cli/measure,splitplane-cli/viewer --no-deps

step "each feature alone, none, and all"
scripts/features.py

step "NEON compiles"
neon=aarch64-unknown-linux-gnu
if rustc --print target-libdir --target "$neon" | xargs test -d; then
    cargo clippy --locked --target "$neon" -p splitplane-core -p splitplane-cpu -- -D warnings
else
    echo "NOT CHECKED: this toolchain has no standard library for $neon"
fi

step "an embedder compiles neither clap nor image nor wgpu"
packages -p splitplane-cli --features measure >"$scratch/program"
packages -p splitplane >"$scratch/embedder"
grep -qx splitplane-cpu "$scratch/embedder" || fail "the embedder's build lacks the CPU backend"
for package in clap image exr png gif obvhs plotters dejavu wgpu naga; do
    # The program has them all: a list in which they cannot be found would prove nothing.
    grep -qx "$package" "$scratch/program" || fail "$package is not found where it must be"
    if grep -qx "$package" "$scratch/embedder"; then
        fail "an embedder with default features compiles $package"
    fi
done
echo "$(wc -l <"$scratch/embedder") packages, of $(wc -l <"$scratch/program") for the program"

step "neither the program nor an embedder compiles egui or winit, but for the viewer"
packages -p splitplane-cli --features viewer >"$scratch/viewer"
packages -p splitplane --features wgpu >"$scratch/gpu"
for package in egui egui-wgpu egui-winit winit; do
    grep -qx "$package" "$scratch/viewer" || fail "$package is not found where it must be"
    for build in program embedder gpu; do
        if grep -qx "$package" "$scratch/$build"; then
            fail "$package is compiled without the feature viewer ($build)"
        fi
    done
done
echo "$(wc -l <"$scratch/viewer") packages with the viewer"

step "no package depends on itself in a circle"
scripts/check_loops.py --locked

step "links of the documents"
scripts/check_links.py

step "every package that is published can be packed"
published=$(scripts/published.py)
# shellcheck disable=SC2086 # one word each
cargo package --locked --no-verify --allow-dirty --quiet $published
echo "$(wc -l <<<"$published") packages"
