#!/usr/bin/env bash
# Builds the package, or the demonstration page: web/build.sh [--page] [--locked]
#
# The package's compiled part goes to web/pkg; the page, ready to be served, to web/target/page. scripts/web.sh setup has what this takes.
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

out=pkg features=()
if [ -n "$page" ]; then
    out=target/page/pkg features=(--features page)
    rm -rf target/page
    mkdir -p target/page
    cp page/*.html page/*.css page/*.js target/page
fi
../scripts/web.sh cargo build --quiet --release ${features[@]+"${features[@]}"} ${lock[@]+"${lock[@]}"}
rm -rf "$out"
../scripts/web.sh bindgen --target web --remove-name-section --remove-producers-section --out-dir "$out" --out-name splitplane \
    "${CARGO_TARGET_DIR:-target}/wasm32-unknown-unknown/release/splitplane_web.wasm"
rm -f "$out/.gitignore" "$out/package.json"
