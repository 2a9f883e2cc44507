#!/usr/bin/env bash
# Gives every shader to the compilers that are here: naga for SPIR-V, HLSL and Metal text, spirv-val before and after spirv-opt,
# DXC for the HLSL. Installs nothing. CI lacks these tools, so it does not run this; the text of HLSL and Metal is checked in
# tests/shaders, which it runs.
#
#   scripts/shader_compilers.sh [FOLDER]
#
# FOLDER      where what compilers are given and write is kept; a temporary one by default
# SPIRV_VAL   spirv-val, and
# SPIRV_OPT   spirv-opt: Debian's package spirv-tools, or the Vulkan SDK
# DXC         dxc: github.com/microsoft/DirectXShaderCompiler
#
# Exit code 0: all accept every shader; 1: one does not; 3: nothing was refused, but a tool is missing, which is named; 2: not
# even naga's text could be made.
set -euo pipefail

folder=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
out=${1:-}
if [ -z "$out" ]; then
    out=$(mktemp -d)
    trap 'rm -rf "$out"' EXIT
fi
mkdir -p "$out"
out=$(cd "$out" && pwd)
spirv_val=${SPIRV_VAL:-spirv-val} spirv_opt=${SPIRV_OPT:-spirv-opt} dxc=${DXC:-dxc}
missing=() refused=0

say() { printf 'shader_compilers.sh: %s\n' "$*" >&2; }
have() {
    command -v "$1" >/dev/null && return
    say "SKIPPED: $2: there is no $1"
    missing+=("$1")
    return 1
}
# Runs a compiler over a file; what it says is shown where it refuses.
accepts() {
    local name=$1
    shift
    if ! "$@" >"$out/log" 2>&1; then
        say "REFUSED: $name: $*"
        sed 's/^/    /' "$out/log" >&2
        refused=$((refused + 1))
    fi
}

cd "$folder"
# The test writes what it checks.
if ! SPLITPLANE_TRANSLATED=$out cargo test --locked --quiet -p splitplane-shader-tests --test suite translated:: >"$out/log" 2>&1; then
    cat "$out/log" >&2
    say "naga's translations fail their test"
    exit 2
fi
shopt -s nullglob
modules=("$out"/*.spv) texts=("$out"/*.hlsl) metal=("$out"/*.metal)
if [ ${#modules[@]} -eq 0 ]; then
    say "no shader was written"
    exit 2
fi

checked=()
if have "$spirv_val" "SPIR-V"; then
    for module in "${modules[@]}"; do
        accepts "$(basename "$module")" "$spirv_val" --target-env vulkan1.2 "$module"
    done
    checked+=("spirv-val")
    if have "$spirv_opt" "SPIR-V that is optimised"; then
        mkdir -p "$out/optimised"
        for module in "${modules[@]}"; do
            made=$out/optimised/$(basename "$module")
            accepts "$(basename "$module")" "$spirv_opt" --target-env=vulkan1.2 -O "$module" -o "$made"
            [ -f "$made" ] && accepts "optimised $(basename "$module")" "$spirv_val" --target-env vulkan1.2 "$made"
        done
        checked+=("spirv-opt -O, then spirv-val")
    fi
fi
if have "$dxc" "HLSL"; then
    for text in "${texts[@]}"; do
        accepts "$(basename "$text")" "$dxc" -T cs_6_0 -E main -HV 2018 "$text" -Fo "$out/dxil"
    done
    checked+=("dxc")
fi
say "${#modules[@]} shaders as SPIR-V, ${#texts[@]} as HLSL, ${#metal[@]} as Metal; by: ${checked[*]:-none}"
[ "$refused" -eq 0 ] || exit 1
[ ${#missing[@]} -eq 0 ] || exit 3
