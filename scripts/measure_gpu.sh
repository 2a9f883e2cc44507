#!/usr/bin/env bash
# Measures splitplane on a GPU: what adapters there are, whether trees and hits are the CPU's bit for
# bit, and how long builds and queries take. Works on any machine with a GPU.
#
#   scripts/measure_gpu.sh [SCENE...]
#
# SCENE           .obj files or builtin:NAME[:SIZE], measured before builtin:city of one and of ten
#                 million triangles; without any those that SPLITPLANE_SCENES names, a list with
#                 commas, or a folder: of that dragon.obj, sponza.obj and bathroom.obj
# ADAPTER         part of an adapter's name or its number; the best one by default
# OUT             where figures go; out/gpu-DATE by default
# BIN_DIR         folder with the programs `splitplane` and `splitplane-measure-gpu`, for machines
#                 without cargo; without it they are built
# PRESETS         presets to compare and to measure, with commas; fast,balanced by default
# MEASURE_OPTIONS more options for `splitplane-measure-gpu`, such as "--reps 21 --rays 8000000"
# SMALL=1         small scenes and few rays, for software adapters
#
# The figures hold the price of the three accuracies in nanoseconds a ray, and of `exact` the share of rays
# that the device leaves undecided; exact hits from host memory are compared with the CPU's, bit for bit.
# Parity is compared on more scenes than are measured, each by every preset: on those, on every .obj file
# of the folder and on all built-in scenes; after every dispatch, but for ten million triangles, where that
# takes too long and the digests have to do. Frames of the built-in carousel, and of robots and horse where
# the folder has them, are made on both backends and compared; their times are in frames-NAME-BACKEND.json.
#
# Exit code 0: everything equal; 1: something differs or a step failed; 5: no GPU.
set -euo pipefail

started=$PWD
folder=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
out=${OUT:-out/gpu-$(date -u +%Y-%m-%d)}
mkdir -p "$out"
out=$(cd "$out" && pwd)
failed=0

# Without a desktop Mesa's layer that orders adapters prints errors that mean nothing here.
export NODEVICE_SELECT=${NODEVICE_SELECT:-1}

say() { printf 'measure_gpu.sh: %s\n' "$*" >&2; }

if [ -n "${BIN_DIR:-}" ]; then
    bin=$(cd "$BIN_DIR" && pwd)
else
    cd "$folder/.."
    cargo build --locked --release --bin splitplane
    cargo build --locked --release -p splitplane-measure-gpu
    target=${CARGO_TARGET_DIR:-target}
    bin=$(cd "$target/release" && pwd)
    cd "$started"
fi
for program in splitplane splitplane-measure-gpu; do
    [ -x "$bin/$program" ] || { say "there is no $bin/$program"; exit 2; }
done

scenes=("$@")
# Scenes that are compared and not measured.
compared=()
if [ ${#scenes[@]} -eq 0 ] && [ -n "${SPLITPLANE_SCENES:-}" ]; then
    if [ -d "$SPLITPLANE_SCENES" ]; then
        for name in dragon sponza bathroom; do
            file=$SPLITPLANE_SCENES/$name.obj
            if [ -f "$file" ]; then
                scenes+=("$file")
            else
                say "there is no $file: left out"
            fi
        done
        for file in "$SPLITPLANE_SCENES"/*.obj; do
            case $(basename "$file") in
            dragon.obj | sponza.obj | bathroom.obj | '*.obj') ;;
            *) compared+=("$file") ;;
            esac
        done
    else
        IFS=, read -r -a scenes <<<"$SPLITPLANE_SCENES"
    fi
fi
compared+=(builtin:cornell builtin:spheres builtin:stadium builtin:city)
options=()
if [ "${SMALL:-}" = 1 ]; then
    scenes+=(builtin:city:20000)
    options+=(--small)
else
    scenes+=(builtin:city:1000000 builtin:city:10000000)
fi
adapter=()
if [ -n "${ADAPTER:-}" ]; then adapter=(--adapter "$ADAPTER"); fi
read -r -a more <<<"${MEASURE_OPTIONS:-}"
IFS=, read -r -a presets <<<"${PRESETS:-fast,balanced}"

{
    date -u +%Y-%m-%dT%H:%M:%SZ
    uname -srm
    grep -m 1 '^model name' /proc/cpuinfo 2>/dev/null || true
    "$bin/splitplane" --version
    git -C "$folder" rev-parse HEAD 2>/dev/null || true
    if command -v nvidia-smi >/dev/null; then
        nvidia-smi --query-gpu=name,driver_version,clocks.sm,clocks.mem,clocks.max.sm,clocks.max.mem,power.limit \
            --format=csv || true
    fi
} | tee "$out/machine.txt"

say "adapters, each with its self-test"
"$bin/splitplane" adapters | tee "$out/adapters.txt"
"$bin/splitplane" adapters --json >"$out/adapters.json"

: >"$out/parity.jsonl"
for scene in "${scenes[@]}" "${compared[@]}"; do
    if [ "$scene" = builtin:city:10000000 ]; then
        say "parity of $scene: by digest only, below"
        continue
    fi
    for preset in "${presets[@]}"; do
        say "parity of $scene by $preset"
        code=0
        "$bin/splitplane" parity "$scene" --preset "$preset" ${adapter[@]+"${adapter[@]}"} --json |
            tee -a "$out/parity.jsonl" || code=$?
        case $code in
        0) ;;
        5) say "no GPU that can be used"; exit 5 ;;
        *) say "parity of $scene by $preset: exit code $code"; failed=1 ;;
        esac
    done
done

say "figures"
code=0
list=$(IFS=,; printf '%s' "${scenes[*]}")
built_by=$(IFS=,; printf '%s' "${presets[*]}")
"$bin/splitplane-measure-gpu" ${adapter[@]+"${adapter[@]}"} ${options[@]+"${options[@]}"} \
    --scenes "$list" --preset "$built_by" --out "$out" ${more[@]+"${more[@]}"} || code=$?
case $code in
0) ;;
5) say "no GPU that can be used"; exit 5 ;;
*) say "figures: exit code $code"; failed=1 ;;
esac
# Frames of scenes that move, on both backends: pictures equal byte for byte, frames a second.
# Arguments: name, picture's size, how many frames, then those of `splitplane animate`.
frames() {
    local name=$1 size=$2 count=$3 backend
    shift 3
    say "frames of $name"
    for backend in cpu wgpu; do
        local device=()
        if [ "$backend" = wgpu ]; then device=(${adapter[@]+"${adapter[@]}"}); fi
        "$bin/splitplane" animate "$@" --size "$size" --count "$count" --backend "$backend" \
            ${device[@]+"${device[@]}"} --out "$out/frames-$name-$backend" --json \
            >"$out/frames-$name-$backend.json" || failed=1
    done
    if diff -rq "$out/frames-$name-cpu" "$out/frames-$name-wgpu"; then
        say "frames of $name: equal"
        rm -r "$out/frames-$name-cpu" "$out/frames-$name-wgpu"
    else
        say "frames of $name differ; both are kept"
        failed=1
    fi
}
if [ "${SMALL:-}" = 1 ]; then
    frames carousel 48x32 2 builtin:carousel:4000
else
    frames carousel 1024x1024 120 builtin:carousel
fi
for name in robots horse; do
    raw=${SPLITPLANE_SCENES:-}/$name.frames.bin
    if [ -d "${SPLITPLANE_SCENES:-}" ] && [ -f "$raw" ]; then
        size=1024x1024 count=160
        if [ "${SMALL:-}" = 1 ]; then size=32x32 count=2; fi
        frames "$name" "$size" "$count" "$SPLITPLANE_SCENES/$name.obj" --frames "$raw" --lights 3
    fi
done

say "figures: $out/gpu.md, raw: $out/gpu.jsonl, machine: $out/machine.txt"
exit "$failed"
