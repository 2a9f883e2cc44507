#!/usr/bin/env bash
# Builds the C library and installs it: capi/install.sh PREFIX [--cpu] [--profile NAME] [--locked | --offline | --frozen]
#
# PREFIX gets include/, lib/ with the shared and the static library, lib/pkgconfig/splitplane.pc and a CMake package. With --cpu no GPU backend is
# compiled in. DESTDIR, where it is set, is put before PREFIX for packagers. Linux, macOS and other Unix systems.
set -euo pipefail

usage() {
    sed -n 2p "$0" >&2
    exit 2
}

prefix= profile=release build=()
while [ $# -gt 0 ]; do
    case $1 in
    --cpu) build+=(--no-default-features) ;;
    --profile)
        [ $# -ge 2 ] || usage
        profile=$2
        shift
        ;;
    --locked | --offline | --frozen) build+=("$1") ;;
    -*) usage ;;
    *)
        [ -z "$prefix" ] || usage
        prefix=$1
        ;;
    esac
    shift
done
[ -n "$prefix" ] || usage
case $prefix in
/*) ;;
*) prefix=$PWD/$prefix ;;
esac

cd "$(dirname "${BASH_SOURCE[0]}")"
cargo build --quiet --profile "$profile" ${build[@]+"${build[@]}"}
built=${CARGO_TARGET_DIR:-target}/$profile
version=$(sed -n 's/^version = "\(.*\)"/\1/p' Cargo.toml | head -n 1)
case $version in
0.*) abi=${version%.*} ;;
*) abi=${version%%.*} ;;
esac

root=${DESTDIR:-}$prefix
mkdir -p "$root/include" "$root/lib/pkgconfig" "$root/lib/cmake/splitplane"
install -m 644 include/splitplane.h include/splitplane.hpp "$root/include/"
install -m 644 "$built/libsplitplane.a" "$root/lib/"
# What a program that links the static library has to link besides: what rustc says.
case $(uname -s) in
Darwin)
    shared=libsplitplane.$abi.dylib
    install -m 755 "$built/libsplitplane.dylib" "$root/lib/$shared"
    ln -sf "$shared" "$root/lib/libsplitplane.dylib"
    private="-framework CoreFoundation -framework Foundation -framework Metal -framework QuartzCore -lobjc -liconv -lm"
    ;;
*)
    shared=libsplitplane.so.$abi
    install -m 755 "$built/libsplitplane.so" "$root/lib/$shared"
    ln -sf "$shared" "$root/lib/libsplitplane.so"
    private="-lgcc_s -lutil -lrt -lpthread -lm -ldl -lc"
    ;;
esac

fill() { sed -e "s|@PREFIX@|$prefix|g; s|@VERSION@|$version|g; s|@SHARED@|$shared|g; s|@PRIVATE@|$private|g" "packaging/$1.in" >"$2"; }
fill splitplane.pc "$root/lib/pkgconfig/splitplane.pc"
fill splitplane-config.cmake "$root/lib/cmake/splitplane/splitplane-config.cmake"
fill splitplane-config-version.cmake "$root/lib/cmake/splitplane/splitplane-config-version.cmake"
chmod 644 "$root/lib/pkgconfig/splitplane.pc" "$root/lib/cmake/splitplane/"*.cmake
echo "splitplane $version is in $root"
