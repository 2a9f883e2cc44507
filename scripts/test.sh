#!/usr/bin/env bash
# Runs all tests: scripts/test.sh [arguments of cargo test]
#
# The GPU tests need a GPU adapter. Where there is none and packages can be installed (Debian, Ubuntu),
# this installs Mesa's software Vulkan. Where that fails too, the GPU tests are ignored, with the reason.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

# Of the arguments those that choose what cargo builds and from what.
build=()
for argument in "$@"; do
    case $argument in
    --) break ;;
    --locked | --offline | --frozen | --release) build+=("$argument") ;;
    esac
done

# Without a desktop Mesa's layer that orders adapters prints errors that mean nothing here.
export NODEVICE_SELECT=${NODEVICE_SELECT:-1}

say() { printf 'test.sh: %s\n' "$*"; }

log=$(mktemp)
trap 'rm -f "$log"' EXIT

# True when wgpu finds an adapter that can be used. Asked of a test, so that the answer is the one the
# tests will get.
adapter_found() {
    cargo test --quiet --workspace ${build[@]+"${build[@]}"} --test adapter -- --exact there_is_a_gpu_adapter >"$log" 2>&1
}

# Commands that install packages run as root, directly or through a sudo that asks nothing.
as_root() {
    if [ "$(id -u)" -eq 0 ]; then
        "$@"
    else
        sudo -n "$@"
    fi
}

install_software_adapter() {
    if ! command -v apt-get >/dev/null; then
        say "there is no apt-get, so nothing can be installed"
        return 1
    fi
    if ! as_root true 2>/dev/null; then
        say "packages can be installed by root only"
        return 1
    fi
    say "installing mesa-vulkan-drivers"
    as_root apt-get update -qq &&
        as_root env DEBIAN_FRONTEND=noninteractive \
            apt-get install -y -qq --no-install-recommends mesa-vulkan-drivers
}

if [ "${SPLITPLANE_GPU:-}" = absent ]; then
    say "SPLITPLANE_GPU=absent is set: GPU tests are ignored"
else
    # A build that fails must not look like a missing adapter.
    cargo test --workspace ${build[@]+"${build[@]}"} --no-run --test adapter
    if adapter_found; then
        say "there is a GPU adapter"
    else
        say "no GPU adapter was found:"
        grep -m 1 'no GPU adapter can be used' "$log" || tail -n 20 "$log"
        if install_software_adapter && adapter_found; then
            say "Mesa's software Vulkan is set up"
        else
            say "no software adapter could be set up either: GPU tests are ignored"
            export SPLITPLANE_GPU=absent
        fi
    fi
fi

say "cargo test --workspace $*"
cargo test --workspace "$@"
