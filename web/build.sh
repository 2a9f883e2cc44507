#!/usr/bin/env bash
# Builds the package, or the demonstration page: web/build.sh [--page] [--locked]
#
# The package's compiled parts go to web/pkg, that for WebGPU to web/pkg/gpu; the page, ready to be served, to web/target/page. scripts/web.sh setup
# has what this takes.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
page= lock=()
for argument in "$@"; do
    case $argument in
    --page) page=yes ;;
    --locked | --offline | --frozen) lock+=("$argument") ;;
    *) echo "build.sh: what is $argument?" >&2 && exit 2 ;;
    esac
done

# part NAME FOLDER [features]: compiles a part.
part() {
    local name=$1 out=$2
    shift 2
    ../scripts/web.sh cargo build --quiet --release "$@" ${lock[@]+"${lock[@]}"}
    rm -rf "$out"
    ../scripts/web.sh bindgen --target web --remove-name-section --remove-producers-section --out-dir "$out" --out-name "$name" \
        "${CARGO_TARGET_DIR:-target}/wasm32-unknown-unknown/release/splitplane_web.wasm"
    rm -f "$out/.gitignore" "$out/package.json"
}

if [ -z "$page" ]; then
    part splitplane pkg
    part splitplane_gpu pkg/gpu --features gpu
else
    rm -rf target/page
    mkdir -p target/page
    cp page/*.html page/*.css page/*.js target/page
    part splitplane target/page/pkg --features page
fi
