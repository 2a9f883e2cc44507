#!/usr/bin/env bash
# Measures splitplane beside other ray tracing libraries: same triangles, same rays, same clock, every
# answer checked against a reference in f64.
#
#   PEERS=path SCENES=folder scripts/measure_peers.sh [OUT]
#
# PEERS   checkout of the comparison harness, built: target/release/peers is started. Where Embree 4 is
#         not found, EMBREE4_LIB names its library.
# SCENES  folder with the scenes, as NAME.obj
# OUT     where results go; out/peers of this repository by default, which git ignores
# NAMES   scenes to measure, "bunny dragon sponza kitchen bathroom" by default
# THREADS thread counts, "1,2" by default
# CLOCK   "cpu" (the default), CPU time of all threads, which other programs disturb least, or "wall". The
#         harness hands it to every program that it starts as PEERS_CLOCK; `splitplane-peer` times itself by it and
#         says in its answer which clock it was. Who starts `splitplane-peer` by hand sets PEERS_CLOCK=cpu: left out,
#         it is "wall", and any other word is an error, as is "cpu" on a system other than Unix.
# REPS    repeats, of which the median counts, 3 by default
# ONLY    other libraries, by the names or beginnings of names that the harness gives them
#
# Our presets are called splitplane-PRESET; see `splitplane-peer` for what else a name may say. Leave
# the machine alone meanwhile. Of kdtree-ray, the only other SAH kd-tree here, only the build is
# comparable: its query lists every candidate.
set -euo pipefail
: "${PEERS:?set PEERS to the checkout of the comparison harness}"
: "${SCENES:?set SCENES to the folder of the scenes}"
names=${NAMES:-bunny dragon sponza kitchen bathroom}
only=${ONLY:-embree4,embree4-avx2,embree4-x16,embree4-x8-avx2,embree4-high,embree4-robust,obvhs-bvh2-medium,obvhs-cwbvh-medium,tinybvh-rs-bvh8,parry3d,bvh,kdtree-ray}
scenes=$(realpath -m "$SCENES")
peers=$(realpath -m "$PEERS")/target/release/peers
root=$(realpath "$(dirname "${BASH_SOURCE[0]}")/..")
out=$(realpath -m "${1:-$root/out/peers}")
cd "$root"
target=$(realpath -m "${CARGO_TARGET_DIR:-target}")

[ -x "$peers" ] || { echo "there is no $peers; build the harness first" >&2; exit 2; }
for scene in $names; do
    [ -f "$scenes/$scene.obj" ] || { echo "there is no $scenes/$scene.obj" >&2; exit 2; }
done

cargo build --locked --release -p splitplane-peer
ours=()
for preset in fast balanced best; do
    ours+=(--extern "splitplane-$preset=$target/release/splitplane-peer")
done
for scene in $names; do
    "$peers" --scene "$scenes/$scene.obj" --rays-out "$out" --threads "${THREADS:-1,2}" \
        --clock "${CLOCK:-cpu}" --reps "${REPS:-3}" --only "$only" "${ours[@]}"
done
"$peers" tables "$out"
echo "results: $out/SCENE/results.md and results.jsonl; all: $out/all.jsonl"
