#!/usr/bin/env bash
# Runs all tests: scripts/test.sh [arguments of cargo test]
#
# The GPU tests need a GPU adapter. Where there is none and packages can be installed (Debian, Ubuntu),
# this installs Mesa's software Vulkan. Where that fails too, the GPU tests are ignored, with the reason.
#
# Without arguments that select tests, those of stack use run again without optimisation, and the tests of
# the viewer run as well. These need a virtual display, which is handled likewise.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Of the arguments those that choose what cargo builds and from what.
build=()
lock=()
selects=
for argument in "$@"; do
    case $argument in
    --locked | --offline | --frozen) build+=("$argument") lock+=("$argument") ;;
    --release) build+=("$argument") ;;
    *) selects=yes ;;
    esac
    [ "$argument" != -- ] || break
done

# Without a desktop Mesa's layer that orders adapters prints errors that mean nothing here.
export NODEVICE_SELECT=${NODEVICE_SELECT:-1}

say() { printf 'test.sh: %s\n' "$*"; }

log=$(mktemp)
trap 'rm -f "$log"' EXIT

# True when wgpu finds an adapter that can be used. Asked of a test, so that the answer is the one the
# tests will get.
adapter_found() {
    cargo test --quiet --workspace --exclude splitplane-viewer ${build[@]+"${build[@]}"} --test suite -- --exact adapter::there_is_a_gpu_adapter >"$log" 2>&1
}

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

if [ "${SPLITPLANE_GPU:-}" = absent ]; then
    say "SPLITPLANE_GPU=absent is set: GPU tests are ignored"
else
    # A build that fails must not look like a missing adapter.
    cargo test --workspace --exclude splitplane-viewer ${build[@]+"${build[@]}"} --no-run --test suite
    if adapter_found; then
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
fi

# The tests must not see the viewer: the program without it is what most people build, and cargo builds
# the viewer's packages only where they are asked for.
tests=(--workspace --exclude splitplane-viewer)
if [ -n "$selects" ]; then
    say "cargo test ${tests[*]} $*"
    cargo test "${tests[@]}" "$@"
    exit
fi

# Without optimisation values take the most stack, and most programs are first built so.
stack=(--profile dev -p splitplane-cpu --test stack)
# Optimising the windowing and drawing crates would take longer than these tests do without it.
viewer=(--profile dev -p splitplane-viewer -p splitplane-cli --features splitplane-cli/viewer --lib --bins --test viewer)
case " ${build[*]-} " in
*" --release "*) viewer=("${viewer[@]:2}") ;;
esac

# Many tests keep one core busy. Beside them the rest is built, in a folder of its own, since cargo lets one command at a
# time build in one; and the Python package, the C interface and the package for JavaScript, which have workspaces and scripts
# of their own, are built and tested. What they print is shown in its turn.
say "cargo test ${tests[*]} --no-run $*"
cargo test "${tests[@]}" --no-run "$@"
unoptimised=${CARGO_TARGET_DIR:-$PWD/target}/unoptimised
beside=$(mktemp -d)
set -m # so that each of these is a process group, which can be ended whole
(
    export CARGO_TARGET_DIR=$unoptimised
    nice cargo test --no-run "${stack[@]}" ${lock[@]+"${lock[@]}"} &&
        nice cargo test --no-run "${viewer[@]}" ${build[@]+"${build[@]}"}
) >"$beside/builds" 2>&1 </dev/null &
builds=$!
nice python/test.sh ${lock[@]+"${lock[@]}"} >"$beside/python" 2>&1 </dev/null &
python=$!
nice capi/test.sh ${lock[@]+"${lock[@]}"} >"$beside/capi" 2>&1 </dev/null &
capi=$!
nice web/test.sh ${lock[@]+"${lock[@]}"} >"$beside/web" 2>&1 </dev/null &
web=$!
set +m
trap 'kill -- "-$builds" "-$python" "-$capi" "-$web" 2>/dev/null || true; rm -rf "$beside" "$log"' EXIT

say "cargo test ${tests[*]} $*"
cargo test "${tests[@]}" "$@"

# The result of a command that ran beside the tests, after what it printed.
finished() {
    local status=0
    wait "$1" || status=$?
    cat "$beside/$2"
    return "$status"
}

say "cargo test ${stack[*]} ${lock[*]-}"
finished "$builds" builds
export CARGO_TARGET_DIR=$unoptimised
cargo test "${stack[@]}" ${lock[@]+"${lock[@]}"}

if [ "${SPLITPLANE_DISPLAY:-}" = absent ]; then
    say "SPLITPLANE_DISPLAY=absent is set: tests that need a display are ignored"
elif ! display_found && ! { install "${display_packages[@]}" && display_found; }; then
    say "no virtual display could be set up: tests that need one are ignored"
    export SPLITPLANE_DISPLAY=absent
fi

say "cargo test ${viewer[*]} ${build[*]-}"
cargo test "${viewer[@]}" ${build[@]+"${build[@]}"}

say "python/test.sh ${lock[*]-}"
finished "$python" python

say "capi/test.sh ${lock[*]-}"
finished "$capi" capi

say "web/test.sh ${lock[*]-}"
finished "$web" web
