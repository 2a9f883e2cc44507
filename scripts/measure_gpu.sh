#!/usr/bin/env bash
# Measures splitplane on a GPU in one call and within ten minutes: what adapters there are, whether trees and hits are the
# CPU's bit for bit, how long builds, queries and frames take, and what was predicted beside what was measured.
#
#   scripts/measure_gpu.sh [SCENE...]
#
# SCENE           .obj files or builtin:NAME[:SIZE], measured before builtin:city of one and of ten
#                 million triangles; without any those that SPLITPLANE_SCENES names, a list with
#                 commas, or a folder: of that sponza.obj, dragon.obj and bathroom.obj
# ADAPTER         part of an adapter's name or its number; the best one by default
# OUT             where figures go; out/gpu-DATE by default
# BIN_DIR         folder with the programs `splitplane` and `splitplane-measure-gpu`, for machines
#                 without cargo; without it they are built, which does not count towards the time
# PRESETS         presets to compare and to measure, with commas; fast,balanced by default
# MEASURE_OPTIONS more options for `splitplane-measure-gpu`, such as "--reps 21 --rays 8000000"
# SECONDS_IN_ALL  what all steps together may take; 570 by default, 0 for no limit
# SMALL=1         small scenes and few rays, for software adapters; no limit of all steps by default, and 20 times that of each
#
# What is most wanted comes first; steps for which no time is left are left out and named. A step that fails, hangs or takes the
# device down does not keep the others from running: each is a process of its own with a limit of time. What each said
# and took is in steps.txt and log.txt. predicted.md has the predictions, gpu.md all tables.
#
# The figures hold the price of the three accuracies in nanoseconds a ray, and of `exact` the share of rays
# that the device leaves undecided; exact hits from host memory are compared with the CPU's, bit for bit.
# Parity is compared on more scenes than are measured, each by every preset: on those, on every .obj file
# of the folder and on all built-in scenes; after every dispatch, but for ten million triangles, where that
# takes too long and the digests have to do. Frames of the built-in carousel, and of robots and horse where
# the folder has them, are made on both backends and compared; their times are in frames-NAME-BACKEND.json.
#
# Exit code 0: everything equal; 1: something differs or a step failed; 4: nothing differed, but steps were left out for lack of
# time; 5: no GPU.
set -uo pipefail

started=$PWD
folder=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
out=${OUT:-out/gpu-$(date -u +%Y-%m-%d)}
mkdir -p "$out" || exit 2
out=$(cd "$out" && pwd)
failed=0
left_out=()

# Without a desktop Mesa's layer that orders adapters prints errors that mean nothing here.
export NODEVICE_SELECT=${NODEVICE_SELECT:-1}
# The first run compiles every kernel; a driver that is new to the machine has none of them in its cache.
export SPLITPLANE_DRIVER_SECONDS=${SPLITPLANE_DRIVER_SECONDS:-240}
export RUST_BACKTRACE=${RUST_BACKTRACE:-1}

say() { printf 'measure_gpu.sh: %s\n' "$*" >&2; }

if [ -n "${BIN_DIR:-}" ]; then
    bin=$(cd "$BIN_DIR" && pwd) || { say "there is no $BIN_DIR"; exit 2; }
else
    cd "$folder/.." || exit 2
    # In one call, so that what both need is built once.
    cargo build --locked --release -p splitplane-cli -p splitplane-measure-gpu || exit 2
    target=${CARGO_TARGET_DIR:-target}
    bin=$(cd "$target/release" && pwd)
    cd "$started" || exit 2
fi
for program in splitplane splitplane-measure-gpu; do
    [ -x "$bin/$program" ] || { say "there is no $bin/$program"; exit 2; }
done

# In containers the loader of Vulkan may not look where NVIDIA's driver was put.
if [ -z "${VK_DRIVER_FILES:-}${VK_ICD_FILENAMES:-}" ] && command -v nvidia-smi >/dev/null; then
    for found in /usr/share/vulkan/icd.d /etc/vulkan/icd.d /usr/local/nvidia/share/vulkan/icd.d; do
        for file in "$found"/nvidia*.json; do
            [ -f "$file" ] && export VK_DRIVER_FILES=$file && say "Vulkan driver: $file" && break 2
        done
    done
fi

all=${SECONDS_IN_ALL:-570} slower=1
if [ "${SMALL:-}" = 1 ]; then all=${SECONDS_IN_ALL:-0} slower=20; fi
begun=$SECONDS
: >"$out/steps.txt"
: >"$out/log.txt"
# Seconds left for a step that may take at most as many as are given.
allowed() {
    local most=$(($1 * slower)) left
    if [ "$all" = 0 ]; then echo "$most"; return; fi
    left=$((all - (SECONDS - begun)))
    echo $((left < most ? left : most))
}
# Runs a step: its name, the most seconds it may take, the command. Standard output goes on; what is said goes to the log too.
# 124: it took too long; 99: it was left out.
step() {
    local name=$1 most=$2 at=$SECONDS code=0 seconds
    shift 2
    seconds=$(allowed "$most")
    # What cannot do anything in the time that is left is not begun.
    if [ "$seconds" -lt 5 ]; then
        left_out+=("$name")
        printf '%s: left out, no time\n' "$name" >>"$out/steps.txt"
        return 99
    fi
    say "$name"
    printf '==> %s: %s\n' "$name" "$*" >>"$out/log.txt"
    if command -v timeout >/dev/null; then
        timeout -k 10 "$seconds" "$@" 2> >(tee -a "$out/log.txt" >&2) || code=$?
    else
        "$@" 2> >(tee -a "$out/log.txt" >&2) || code=$?
    fi
    printf '%s: exit code %s, %s s\n' "$name" "$code" "$((SECONDS - at))" | tee -a "$out/steps.txt" >&2
    [ "$code" = 124 ] && say "$name: stopped after $seconds s"
    return "$code"
}

scenes=("$@")
# Scenes that are compared and not measured.
compared=()
if [ ${#scenes[@]} -eq 0 ] && [ -n "${SPLITPLANE_SCENES:-}" ]; then
    if [ -d "$SPLITPLANE_SCENES" ]; then
        for name in sponza dragon bathroom; do
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
    nproc 2>/dev/null || true
    "$bin/splitplane" --version || true
    git -C "$folder" rev-parse HEAD 2>/dev/null || true
    if command -v nvidia-smi >/dev/null; then
        timeout 20 nvidia-smi --query-gpu=name,driver_version,clocks.sm,clocks.mem,clocks.max.sm,clocks.max.mem,power.limit \
            --format=csv || true
    fi
    ldconfig -p 2>/dev/null | grep libvulkan || echo "no libvulkan in the loader's cache"
} 2>&1 | tee "$out/machine.txt"

step "adapters, each with its self-test" 280 "$bin/splitplane" adapters | tee "$out/adapters.txt"
step "adapters as JSON" 60 "$bin/splitplane" adapters --json >"$out/adapters.json"

# One scene by all presets, a process of its own: a scene that takes the device down leaves the others be.
measure() {
    local scene=$1 most=$2 code=0 place
    shift 2
    place=$out/figures/$(basename "$scene" .obj | tr -c 'A-Za-z0-9\n' -)
    step "figures of $scene" "$most" "$bin/splitplane-measure-gpu" ${adapter[@]+"${adapter[@]}"} \
        ${options[@]+"${options[@]}"} --scenes "$scene" --preset "${PRESETS:-fast,balanced}" --out "$place" "$@" \
        ${more[@]+"${more[@]}"} >/dev/null || code=$?
    if [ -f "$place/gpu.md" ]; then
        # What the step wrote before it ended, however it ended.
        { printf '\n<!-- %s -->\n' "$scene"; cat "$place/gpu.md"; } >>"$out/gpu.md"
        sed -n '/^## Predicted/,/^## What is wrong/p' "$place/gpu.md" | grep -v '^## What is wrong' >>"$out/predicted.md"
        cat "$place/gpu.jsonl" >>"$out/gpu.jsonl"
    fi
    case $code in
    0 | 99) ;;
    5) return 5 ;;
    *) say "figures of $scene: exit code $code"; failed=1 ;;
    esac
}
# Arguments: scene, then the most seconds for it by one preset.
parity() {
    local scene=$1 most=$2 preset code
    if [ "$scene" = builtin:city:10000000 ]; then
        say "parity of $scene: by digest only, with its figures"
        return 0
    fi
    for preset in "${presets[@]}"; do
        code=0
        step "parity of $scene by $preset" "$most" "$bin/splitplane" parity "$scene" --preset "$preset" \
            ${adapter[@]+"${adapter[@]}"} --json >"$out/parity.json" || code=$?
        cat "$out/parity.json" 2>/dev/null | tee -a "$out/parity.jsonl"
        rm -f "$out/parity.json"
        case $code in
        0 | 99) ;;
        5) return 5 ;;
        *) say "parity of $scene by $preset: exit code $code"; failed=1 ;;
        esac
    done
}
# Frames of scenes that move, on both backends: pictures equal byte for byte, frames a second.
# Arguments: name, picture's size, how many frames, then those of `splitplane animate`.
frames() {
    local name=$1 size=$2 count=$3 backend code
    shift 3
    for backend in wgpu cpu; do
        local device=()
        if [ "$backend" = wgpu ]; then device=(--allow-structural ${adapter[@]+"${adapter[@]}"}); fi
        code=0
        step "frames of $name on $backend" 100 "$bin/splitplane" animate "$@" --size "$size" --count "$count" \
            --backend "$backend" ${device[@]+"${device[@]}"} --out "$out/frames-$name-$backend" --json \
            >"$out/frames-$name-$backend.json" || code=$?
        case $code in
        0) ;;
        99) return 0 ;;
        *) failed=1; return 0 ;;
        esac
    done
    if diff -rq "$out/frames-$name-cpu" "$out/frames-$name-wgpu"; then
        say "frames of $name: equal"
        rm -r "$out/frames-$name-cpu" "$out/frames-$name-wgpu"
    else
        say "frames of $name differ; both are kept"
        failed=1
    fi
}
no_gpu() {
    say "no GPU that can be used"
    exit 5
}

rm -rf "$out/figures"
: >"$out/parity.jsonl"
: >"$out/gpu.md"
: >"$out/gpu.jsonl"
: >"$out/predicted.md"

# First a quick look at whether anything agrees, then the first scene, then the others by size, then what is left.
parity builtin:cornell 60 || no_gpu
measure "${scenes[0]}" 200 || no_gpu
parity "${scenes[0]}" 60 || no_gpu
if [ "${SMALL:-}" = 1 ]; then
    frames carousel 48x32 2 builtin:carousel:4000
else
    frames carousel 1024x1024 60 builtin:carousel
fi
for scene in "${scenes[@]:1}"; do
    few=()
    # The CPU's builds of millions of triangles are what takes long.
    case "$scene ${MEASURE_OPTIONS:-}" in *--reps*) ;; builtin:city:1000*) few=(--reps 5) ;; esac
    measure "$scene" 150 ${few[@]+"${few[@]}"} || no_gpu
done
for scene in "${scenes[@]:1}" "${compared[@]}"; do
    [ "$scene" = builtin:cornell ] || parity "$scene" 60 || no_gpu
done
for name in robots horse; do
    raw=${SPLITPLANE_SCENES:-}/$name.frames.bin
    if [ -d "${SPLITPLANE_SCENES:-}" ] && [ -f "$raw" ]; then
        size=1024x1024 count=60
        if [ "${SMALL:-}" = 1 ]; then size=32x32 count=2; fi
        frames "$name" "$size" "$count" "$SPLITPLANE_SCENES/$name.obj" --frames "$raw" --lights 3
    fi
done

cat "$out/predicted.md"
say "figures: $out/gpu.md, predictions: $out/predicted.md, raw: $out/gpu.jsonl, machine: $out/machine.txt"
say "$((SECONDS - begun)) s"
if [ ${#left_out[@]} -gt 0 ]; then
    printf 'measure_gpu.sh: left out: %s\n' "${left_out[@]}" >&2
    [ "$failed" = 1 ] || exit 4
fi
exit "$failed"
