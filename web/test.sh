#!/usr/bin/env bash
# Builds and tests the package for JavaScript and the demonstration page: web/test.sh [--locked] [--no-build]
#
# Takes what scripts/web.sh sets up. Where that is not there, this says what is missing and tests nothing; with SPLITPLANE_WEB=required
# that is a failure. Tests in a browser need Chromium (scripts/web.sh setup --browser), those of three.js npm.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"
tools=${SPLITPLANE_WEB_TOOLS:-$PWD/target/tools}

say() { printf 'web/test.sh: %s\n' "$*"; }
absent() {
    say "NOT TESTED: $*"
    [ "${SPLITPLANE_WEB:-}" != required ] || exit 1
}

build=yes lock=()
for argument in "$@"; do
    case $argument in
    --no-build) build= ;;
    --locked | --offline | --frozen) lock+=("$argument") ;;
    *) say "what is $argument?" && exit 2 ;;
    esac
done

if [ "${SPLITPLANE_WEB:-}" = absent ] || ! ../scripts/web.sh check; then
    absent "the package for JavaScript: there is no toolchain for it"
    exit 0
fi
export CARGO_INCREMENTAL=0

if [ -n "$build" ]; then
    say "format"
    cargo fmt --check
    say "the package"
    ./build.sh ${lock[@]+"${lock[@]}"}
    say "the demonstration page"
    ./build.sh --page ${lock[@]+"${lock[@]}"}
fi

why=$(../scripts/web.sh can-share) || absent "threads: $why"

say "size"
node tests/size.mjs

say "answers, misuse, and threads"
node --test tests/answers.test.mjs tests/misuse.test.mjs tests/threads.test.mjs

if [ -d node_modules/three ] || npm install --silent --no-audit --no-fund --no-save; then
    say "three.js"
    node --test tests/three.test.mjs
    say "types"
    npx --no-install tsc --project tests/tsconfig.json
    say "the example for Vite"
    rm -rf target/vite
    cp -r examples/vite target/vite
    # There `splitplane` is this folder as well: the copy is as deep in it.
    if npm install --silent --no-audit --no-fund --prefix target/vite; then
        (cd target/vite && npx --no-install vite build --base ./ --logLevel warn)
        node tests/bundle.mjs target/vite/dist
    else
        absent "the example for Vite: npm cannot install it"
    fi
else
    absent "the functions for three.js, and the types: npm cannot install three and typescript"
fi

if command -v chromium >/dev/null && [ -d "$tools/node_modules/playwright-core" ]; then
    say "in a browser"
    node tests/browser.mjs "$tools"
    say "WebGPU, by SwiftShader"
    status=0
    node tests/webgpu.mjs "$tools" || status=$?
    [ "$status" != 3 ] || absent "WebGPU: this Chromium has no adapter for it"
    [ "$status" = 0 ] || [ "$status" = 3 ] || exit "$status"
else
    absent "in a browser: there is no Chromium with its driver; scripts/web.sh setup --browser sets them up"
fi
say "all passed"
