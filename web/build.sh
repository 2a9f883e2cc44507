#!/usr/bin/env bash
# Builds the package, or the demonstration page: web/build.sh [--page] [--locked]
#
# The package's compiled parts go to web/pkg, that for WebGPU to web/pkg/gpu, that for threads to web/pkg/threads; the page, ready to be
# served, to web/target/page. scripts/web.sh setup has what this takes. The parts for threads need a standard library that is built for
# shared memory; where that cannot be had, a file in their place says so to programs that ask for threads.
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
    ../scripts/web.sh optimise "$out/${name}_bg.wasm"
    [ -z "${SPLITPLANE_WEB_SHARED:-}" ] || node scripts/guard-waits.mjs "$out/${name}_bg.wasm"
    rm -f "$out/.gitignore" "$out/package.json"
}

# threads FOLDER FEATURES: the same in memory that workers share, under a name of its own, or what says that it is not there.
threads() {
    local why
    if why=$(../scripts/web.sh can-share); then
        SPLITPLANE_WEB_SHARED=yes CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$PWD/target}/shared part splitplane_threads "$1" --features "$2"
        return
    fi
    echo "build.sh: WITHOUT THREADS: $why" >&2
    rm -rf "$1"
    mkdir -p "$1"
    echo "export const missing = \"the part for threads was not built: $why\";" >"$1/splitplane_threads.js"
}

if [ -z "$page" ]; then
    part splitplane pkg
    part splitplane_gpu pkg/gpu --features gpu
    threads pkg/threads threads
else
    rm -rf target/page
    mkdir -p target/page
    cp page/*.html page/*.css page/*.js js/error.js js/pool.js target/page
    part splitplane target/page/pkg --features page-gpu
    threads target/page/pkg/threads page,threads
fi
