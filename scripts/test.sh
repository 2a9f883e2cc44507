#!/usr/bin/env bash
# Runs the tests: scripts/test.sh [--quick] [arguments of cargo test]
#
# Alone: all tests, those of the packages for Python, C and JavaScript where their tools are there,
# and the program's stack use without optimisation. Ends with the slowest tests.
# --quick: what to run at each change. Leaves out the packages, the viewer and scripts/slow_tests.txt.
# With arguments that select tests: these alone.
#
# Tests of the GPU need an adapter, those of the viewer a virtual display. Where one is missing and
# packages can be installed (Debian, Ubuntu), this installs Mesa's software Vulkan or Xvfb. Where
# that fails too, these tests are ignored, with the reason.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Of the arguments those that choose what cargo builds and from what.
build=()
lock=()
selected=()
selects=
quick=
for argument in "$@"; do
    case $argument in
    --quick) quick=yes && continue ;;
    --locked | --offline | --frozen) build+=("$argument") lock+=("$argument") ;;
    --release) build+=("$argument") ;;
    *) selects=yes ;;
    esac
    selected+=("$argument")
done

# Without a desktop Mesa's layer that orders adapters prints errors that mean nothing here.
export NODEVICE_SELECT=${NODEVICE_SELECT:-1}

say() { printf 'test.sh: %s\n' "$*"; }

beside=$(mktemp -d)
log=$beside/log
trap 'rm -rf "$beside"' EXIT

# Commands that install packages run as root, directly or through a sudo that asks nothing.
as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    else
        sudo -n "$@"
    fi
}

install() {
    if ! command -v apt-get >/dev/null; then
        say "there is no apt-get, so nothing can be installed"
        return 1
    fi
    if ! as_root true 2>/dev/null; then
        say "packages can be installed by root only"
        return 1
    fi
    say "installing $*"
    as_root apt-get update -qq &&
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@"
}

# What the tests of the viewer run, and libraries that windows load when they open.
display_programs=(Xvfb xwd xdotool)
display_libraries=(libX11.so.6 libX11-xcb.so.1 libXcursor.so.1 libXi.so.6 libxkbcommon-x11.so.0)
display_packages=(xvfb x11-apps xdotool libx11-6 libx11-xcb1 libxcursor1 libxi6 libxkbcommon-x11-0)

display_found() {
    local loadable name
    for name in "${display_programs[@]}"; do
        command -v "$name" >/dev/null || { say "$name is not installed"; return 1; }
    done
    loadable=$(PATH=$PATH:/sbin:/usr/sbin ldconfig -p 2>/dev/null) || return 1
    for name in "${display_libraries[@]}"; do
        case $loadable in
        *"$name"*) ;;
        *) say "$name is not installed"; return 1 ;;
        esac
    done
}

# One build for all programs: cargo unites the features of what it builds together, so another
# selection of packages would compile most of them again.
tests=(--workspace --features "splitplane-cli/measure,splitplane-cli/viewer")
if [ -n "$quick" ]; then
    tests=(--workspace --exclude splitplane-viewer --features splitplane-cli/measure)
fi
tests+=(${build[@]+"${build[@]}"})

# True when wgpu finds an adapter that can be used. Asked of a test, so that the answer is the one the
# tests will get.
adapter_found() {
    cargo test --quiet "${tests[@]}" --test suite -- --exact adapter::there_is_a_gpu_adapter >"$log" 2>&1
}

say "cargo test ${tests[*]} --no-run"
cargo test "${tests[@]}" --no-run
if [ "${SPLITPLANE_GPU:-}" = absent ]; then
    say "SPLITPLANE_GPU=absent is set: GPU tests are ignored"
elif adapter_found; then
    say "there is a GPU adapter"
else
    say "no GPU adapter was found:"
    grep -m 1 'no GPU adapter can be used' "$log" || tail -n 20 "$log"
    if install mesa-vulkan-drivers && adapter_found; then
        say "Mesa's software Vulkan is set up"
    else
        say "no software adapter could be set up either: GPU tests are ignored"
        export SPLITPLANE_GPU=absent
    fi
fi

if [ -z "$quick" ]; then
    if [ "${SPLITPLANE_DISPLAY:-}" = absent ]; then
        say "SPLITPLANE_DISPLAY=absent is set: tests that need a display are ignored"
    elif ! display_found && ! { install "${display_packages[@]}" && display_found; }; then
        say "no virtual display could be set up: tests that need one are ignored"
        export SPLITPLANE_DISPLAY=absent
    fi
fi

# Cargo's runner has each test print its time.
triple=$(rustc -vV | sed -n 's/^host: //p' | tr 'a-z-' 'A-Z_')
export "CARGO_TARGET_${triple}_RUNNER=$PWD/scripts/run_test.sh"
run() {
    say "cargo test $*"
    cargo test "$@" 2>&1 | tee -a "$log"
}
: >"$log"

if [ -n "$selects" ]; then
    cargo test "${tests[@]}" "${selected[@]}"
    exit
fi
if [ -n "$quick" ]; then
    skip=()
    while read -r name; do skip+=(--skip "$name"); done <scripts/slow_tests.txt
    run "${tests[@]}" --lib --bins --tests -- "${skip[@]}"
    scripts/test_times.py "$log"
    exit
fi

# Many tests keep one core busy. Beside them the rest is built and tested: what takes the most stack,
# which is code without optimisation, and the packages for Python, C and JavaScript, which have
# workspaces and scripts of their own. What they print is shown in its turn.
stack=(--profile unoptimised -p splitplane-cpu --test stack)
bindings=${CARGO_TARGET_DIR:-$PWD/target}/bindings
set -m # so that each of these is a process group, which can be ended whole
(nice cargo test ${lock[@]+"${lock[@]}"} "${stack[@]}") >"$beside/stack" 2>&1 </dev/null &
unoptimised=$!
# These two share what they compile.
(
    export CARGO_TARGET_DIR=$bindings
    nice capi/test.sh ${lock[@]+"${lock[@]}"} && nice python/test.sh ${lock[@]+"${lock[@]}"}
) >"$beside/bindings" 2>&1 </dev/null &
packages=$!
nice web/test.sh ${lock[@]+"${lock[@]}"} >"$beside/web" 2>&1 </dev/null &
web=$!
set +m
trap 'kill -- "-$unoptimised" "-$packages" "-$web" 2>/dev/null || true; rm -rf "$beside"' EXIT

run "${tests[@]}"

# The result of a command that ran beside the tests, after what it printed.
finished() {
    local status=0
    say "$3"
    wait "$1" || status=$?
    cat "$beside/$2"
    return "$status"
}
finished "$unoptimised" stack "cargo test ${stack[*]}"
finished "$packages" bindings "capi/test.sh and python/test.sh"
finished "$web" web "web/test.sh"

say "what the whole costs to compile"
scripts/compile_cost.py
say "times"
scripts/test_times.py "$log"
