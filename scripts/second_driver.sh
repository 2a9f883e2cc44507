#!/usr/bin/env bash
# Holds splitplane on a second Vulkan driver, SwiftShader, to the CPU: another compiler, which flushes before it rounds.
#
#   scripts/second_driver.sh
#
# SWIFTSHADER      libvk_swiftshader.so; otherwise that of an installed chromium, or one that is unpacked from Debian's
#                  package chromium-common by apt-get, without installing it
# SWIFTSHADER_LIBS folder with libraries that it needs and the system lacks, such as those of a chromium that is unpacked
# BIN_DIR          folder with the program `splitplane`, and with `examples/compile_shaders`; without it, they are built
# OUT              where files and the log go; a folder that goes again by default
# ADAPTER_SECONDS  what listing adapters may take; 30 by default
# SECONDS_A_STEP   what each step may take; 600 by default
# MEMORY_KIB       what each step may take of address space; 6000000 by default
#
# Each step is a process of its own within these limits. Adapters are listed within 30 seconds of an idle machine; every shader by itself
# compiles within 5 seconds of processor time and 1 GiB (`shaders.txt` and `shaders.json` in OUT); a scene of 10,000 triangles is built by
# each preset in step with the CPU; hits of every kind by accuracies watertight and exact, points inside, and frames of 64x64, exact ones too, give the CPU's files,
# byte for byte.
#
# Exit code 0: everything equal; 1: something differs or a step failed; 5: there is no SwiftShader.
set -uo pipefail

folder=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
say() { printf 'second_driver.sh: %s\n' "$*" >&2; }
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
out=${OUT:-$work}
mkdir -p "$out" || exit 1
seconds=${SECONDS_A_STEP:-600}
memory=${MEMORY_KIB:-6000000}

# The library, wherever it is.
library=${SWIFTSHADER:-}
if [ -z "$library" ]; then
    for place in /usr/lib/chromium /usr/lib/chromium-browser /usr/lib64/chromium-browser; do
        [ -e "$place/libvk_swiftshader.so" ] && library=$place/libvk_swiftshader.so && break
    done
fi
if [ -z "$library" ] && command -v apt-get >/dev/null; then
    say "unpacking Debian's chromium-common"
    if (cd "$work" && apt-get -qq download chromium-common) >/dev/null 2>&1; then
        dpkg --fsys-tarfile "$work"/chromium-common*.deb |
            tar -x -C "$work" ./usr/lib/chromium/libvk_swiftshader.so
        library=$work/usr/lib/chromium/libvk_swiftshader.so
    fi
fi
[ -e "$library" ] || { say "there is no libvk_swiftshader.so; say where it is by SWIFTSHADER"; exit 5; }

if [ -n "${BIN_DIR:-}" ]; then
    program=$(cd "$BIN_DIR" && pwd)/splitplane
else
    (cd "$folder/.." && cargo build --locked --release -p splitplane-cli &&
        cargo build --locked --release -p splitplane-wgpu --example compile_shaders) || exit 1
    program=$(cd "${CARGO_TARGET_DIR:-$folder/../target}/release" && pwd)/splitplane
fi
compile_shaders=$(dirname "$program")/examples/compile_shaders
[ -x "$program" ] || { say "there is no $program"; exit 1; }

printf '{"file_format_version": "1.0.0", "ICD": {"library_path": "%s", "api_version": "1.3.0"}}\n' \
    "$(cd "$(dirname "$library")" && pwd)/$(basename "$library")" >"$work/driver.json"
export VK_ICD_FILENAMES=$work/driver.json VK_DRIVER_FILES=$work/driver.json
export VK_LOADER_LAYERS_DISABLE='~all~' WGPU_BACKEND=vulkan NODEVICE_SELECT=1
# A busy machine compiles slowly.
export SPLITPLANE_DRIVER_SECONDS=${SPLITPLANE_DRIVER_SECONDS:-240}
export LD_LIBRARY_PATH=${SWIFTSHADER_LIBS:-}${SWIFTSHADER_LIBS:+:}${LD_LIBRARY_PATH:-}

failed=0
# step LIMIT NAME COMMAND...
step() {
    local limit=$1 name=$2 start=$SECONDS status
    shift 2
    (ulimit -v "$memory" && timeout -k 10 "$limit" "$@") >>"$out/log.txt" 2>&1
    status=$?
    if [ "$status" -ne 0 ]; then
        say "FAILED: $name (exit $status after $((SECONDS - start)) s); $out/log.txt ends:"
        tail -n 5 "$out/log.txt" >&2
        failed=1
        return 1
    fi
    say "$name: $((SECONDS - start)) s"
}

# same NAME OPTIONS...: what `splitplane OPTIONS FILE` writes on both backends.
same() {
    local name=$1 file=$2 backend
    shift 2
    for backend in cpu wgpu; do
        step "$seconds" "$name on $backend" "$program" "$@" "$out/$backend-$file" --backend "$backend" || return
    done
    for written in "$out/cpu-${file%.*}"*; do
        if ! cmp "$written" "${written/cpu-/wgpu-}" >&2; then
            say "DIFFERS: $name"
            failed=1
        fi
    done
}

: >"$out/log.txt"
# With the program's own limits of time, in which a busy machine does not count; here it does.
(unset SPLITPLANE_DRIVER_SECONDS && step "${ADAPTER_SECONDS:-30}" "adapters" "$program" adapters) || exit 1
grep -qi swiftshader "$out/log.txt" || { say "SwiftShader is not among the adapters: see $out/log.txt"; exit 1; }

if [ -x "$compile_shaders" ]; then
    "$compile_shaders" SwiftShader swiftshader "$out/shaders.json" >"$out/shaders.txt"
    status=$?
    tail -n 1 "$out/shaders.txt" >&2
    if [ "$status" -ne 0 ]; then
        say "FAILED: shaders"
        grep -E 'FAILED|TOO MUCH' "$out/shaders.txt" >&2
        failed=1
    fi
else
    say "there is no $compile_shaders: shaders are not compiled one by one"
fi

scene=${SCENE:-builtin:carousel:10000}
for preset in fast balanced narrow; do
    step "$seconds" "parity of $preset" "$program" parity "$scene" --preset "$preset" --rays 2000
done

# Rays from all around at points in the scene, and points in and beside it: by a sequence, so that they are the same everywhere.
python3 - "$out/rays.bin" "$out/points.bin" <<'PYTHON' || exit 1
import struct, sys
state = 1
def number():
    global state
    state = (state * 747796405 + 2891336453) % 2**32
    return (state >> 8) / 2**23 - 1
with open(sys.argv[1], "wb") as rays, open(sys.argv[2], "wb") as points:
    for _ in range(4000):
        origin = [12 * number() for _ in range(3)]
        at = [3 * number() for _ in range(3)]
        way = [b - a for a, b in zip(origin, at)]
        rays.write(struct.pack("<8f", *origin, *way, 0.0, float("inf")))
        points.write(struct.pack("<3f", *at))
PYTHON
for accuracy in watertight exact; do
    for kind in closest any; do
        same "$kind hits, $accuracy" "$kind-$accuracy.bin" query "$scene" --kind "$kind" --accuracy "$accuracy" --rays "$out/rays.bin" --hits
    done
done
same "all hits" all.bin query "$scene" --kind all --rays "$out/rays.bin" --hits
same "points inside" inside.bin query "$scene" --kind inside --points "$out/points.bin" --hits
for accuracy in watertight exact; do
    for picture in "$scene" builtin:cornell builtin:forest:30; do
        name=${picture#builtin:}
        same "frame of $name, $accuracy" "${name%%:*}-$accuracy.png" render "$picture" --accuracy "$accuracy" --size 64x64 --samples 1 -o
    done
done
[ "$failed" -eq 0 ] && say "everything is equal"
exit "$failed"
