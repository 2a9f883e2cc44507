#!/usr/bin/env bash
# Measures splitplane beside other ray tracing libraries: same triangles, same rays, same clock, every
# answer checked against a reference in f64.
#
#   PEERS=path SCENES=folder scripts/measure_peers.sh [OUT]
#
# PEERS   checkout of the comparison harness, built: target/release/peers is started. Where Embree 4 is
#         not found, EMBREE4_LIB names its library.
# SCENES  folder with bunny.obj, dragon.obj, sponza.obj and kitchen.obj
# OUT     where results go; out/peers of this repository by default, which git ignores
#
# Each scene runs on 1 and 2 threads, 3 repeats, medians. Leave the machine alone meanwhile. Of
# kdtree-ray, the only other SAH kd-tree here, only the build is comparable: its query lists every
# candidate.
set -euo pipefail
: "${PEERS:?set PEERS to the checkout of the comparison harness}"
: "${SCENES:?set SCENES to the folder of the scenes}"
scenes=$(realpath -m "$SCENES")
peers=$(realpath -m "$PEERS")/target/release/peers
root=$(realpath "$(dirname "${BASH_SOURCE[0]}")/..")
out=$(realpath -m "${1:-$root/out/peers}")
cd "$root"
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")

[ -x "$peers" ] || { echo "there is no $peers; build the harness first" >&2; exit 2; }
for scene in bunny dragon sponza kitchen; do
    [ -f "$scenes/$scene.obj" ] || { echo "there is no $scenes/$scene.obj" >&2; exit 2; }
done

cargo build --locked --release -p splitplane-peer
for scene in bunny dragon sponza kitchen; do
    "$peers" --scene "$scenes/$scene.obj" --rays-out "$out" --threads 1,2 --reps 3 \
        --only embree4,bvh,obvhs-bvh2-medium,parry3d,kdtree-ray \
        --extern "splitplane-fast=$target/release/splitplane-peer"
done
"$peers" tables "$out"
echo "results: $out/SCENE/results.md and results.jsonl; all: $out/all.jsonl"
