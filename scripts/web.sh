#!/usr/bin/env bash
# The toolchain of the package for JavaScript: a Rust compiler for wasm32-unknown-unknown, the programs wasm-bindgen and wasm-opt, and a
# browser for tests.
#
#   scripts/web.sh setup            what building takes; safe to run again
#   scripts/web.sh setup --browser  and what tests in a browser take: Chromium and its driver
#   scripts/web.sh check            says what is there and what is missing; installs nothing
#   scripts/web.sh cargo ...        cargo for wasm32-unknown-unknown
#   scripts/web.sh can-share        whether modules for threads can be made (SPLITPLANE_WEB_SHARED=yes for cargo): says why not
#   scripts/web.sh bindgen ...      the program wasm-bindgen, of the version of web/Cargo.lock
#   scripts/web.sh optimise FILE    the program wasm-opt over a module, in place
#
# The compiler is the installed one where it has the standard library of that target, or where rustup can add it. Else it is that of
# Debian's packages rustc-web, cargo-web and rust-web-src: they are unpacked, not installed, and cargo builds the standard library.
# Everything goes to web/target/tools, or where SPLITPLANE_WEB_TOOLS says.
set -euo pipefail
root=$(cd "$(dirname "${BASH_SOURCE[0]}")/.." && pwd)
tools=${SPLITPLANE_WEB_TOOLS:-$root/web/target/tools}
target=wasm32-unknown-unknown
oldest=$(sed -n 's/^rust-version = "\(.*\)"$/\1/p' "$root/web/Cargo.toml")
bindgen_version=$(grep -A1 '^name = "wasm-bindgen"$' "$root/web/Cargo.lock" | sed -n 's/^version = "\(.*\)"$/\1/p')
driver_version=1.65.1
# The package of npm that has wasm-opt; the program's own version is its first number.
optimiser_version=132.0.0

say() { printf 'web.sh: %s\n' "$*"; }
missing() {
    say "missing: $*" >&2
    exit 1
}

# True where the installed compiler has the standard library of the target.
installed_has_target() {
    command -v rustc >/dev/null && [ -d "$(rustc --print target-libdir --target "$target" 2>/dev/null)" ]
}
unpacked() { [ -e "$tools/rust/ready" ]; }

as_root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo -n "$@"; fi; }

# Packages of Debian, and what they need that is not there, unpacked into a folder: installed they would be in the way of other compilers.
unpack() {
    local into=$1 folder package
    shift
    folder=$(mktemp -d)
    mapfile -t packages < <({
        printf '%s\n' "$@"
        apt-get -s -qq --no-install-recommends install "$@" | awk '$1 == "Inst" { print $2 }'
    } | sort -u)
    (cd "$folder" && apt-get -qq -o APT::Sandbox::User=root download "${packages[@]}")
    rm -rf "$into"
    mkdir -p "$into"
    for package in "$folder"/*.deb; do
        dpkg-deb --fsys-tarfile "$package" | tar -x -C "$into" --exclude=./usr/share/doc --exclude=./usr/share/man
    done
    rm -rf "$folder"
}

# Sources of the standard library, of which that for shared memory is built.
add_sources() {
    { command -v rustup && timeout 120 rustup component add rust-src; } >/dev/null 2>&1 ||
        say "rustup cannot add rust-src: modules for threads will be left out"
}

setup_rust() {
    if unpacked; then return; fi
    if installed_has_target; then
        installed_has_sources || add_sources
        return
    fi
    if command -v rustup >/dev/null && timeout 120 rustup target add "$target" >/dev/null 2>&1; then
        say "rustup has added $target"
        add_sources
        return
    fi
    command -v apt-get >/dev/null ||
        missing "the standard library for $target: rustup cannot add it, and there is no apt-get"
    as_root apt-get update -qq 2>/dev/null || say "the lists of packages could not be refreshed"
    local version llvm
    version=$(apt-cache policy rustc-web | awk '$1 == "Candidate:" { print $2 }')
    dpkg --compare-versions "${version:-0}" ge "$oldest" ||
        missing "a compiler for $target: rustup cannot add it, and the package rustc-web is ${version:-not there}; $oldest is needed"
    llvm=$(apt-cache depends --recurse --important rustc-web | sed -n 's/^libllvm\([0-9]*\)$/\1/p' | sort -n | tail -n 1)
    unpack "$tools/rust" rustc-web cargo-web rust-web-src "lld-$llvm"
    ln -sf "usr/bin/wasm-ld-$llvm" "$tools/rust/wasm-ld"
    touch "$tools/rust/ready"
    say "unpacked the compiler ($version) into $tools/rust"
}

# What shared memory takes: instructions for it, memory that is handed in, and what a thread is begun by.
shared_flags="-C target-feature=+simd128,+atomics,+bulk-memory -C link-arg=--shared-memory -C link-arg=--import-memory \
-C link-arg=--max-memory=4294967296 -C link-arg=--export=__wasm_init_tls -C link-arg=--export=__tls_size -C link-arg=--export=__tls_align \
-C link-arg=--export=__tls_base -C link-arg=--export=__heap_base"

# The standard library that compilers come with has no atomic instructions, so that for shared memory is built from its sources.
installed_has_sources() {
    installed_has_target && [ -e "$(rustc --print sysroot)/lib/rustlib/src/rust/library/std/Cargo.toml" ]
}
can_share() {
    if unpacked || installed_has_sources; then return; fi
    echo "the compiler has no sources of its standard library, which has to be built for shared memory (rustup component add rust-src)"
    return 1
}

run_cargo() {
    export CARGO_TARGET_DIR=${CARGO_TARGET_DIR:-$root/web/target} CARGO_BUILD_TARGET=$target
    # Lanes of 128 bits, which every browser has had since 2023.
    export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS=${SPLITPLANE_WEB_RUSTFLAGS--C target-feature=+simd128}
    [ -z "${SPLITPLANE_WEB_SHARED:-}" ] || export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_RUSTFLAGS=$shared_flags
    if installed_has_target && ! unpacked; then
        [ -z "${SPLITPLANE_WEB_SHARED:-}" ] || export RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=std,panic_abort
        exec cargo "$@"
    fi
    unpacked || missing "a compiler for $target; run scripts/web.sh setup"
    local rust=$tools/rust
    export LD_LIBRARY_PATH="$rust/usr/lib/$(uname -m)-linux-gnu${LD_LIBRARY_PATH:+:$LD_LIBRARY_PATH}"
    export RUSTC=$rust/usr/bin/rustc RUSTDOC=$rust/usr/bin/rustdoc
    # Where the standard library is built from source, which a stable compiler does when told to.
    export RUSTC_BOOTSTRAP=1 CARGO_UNSTABLE_BUILD_STD=std,panic_abort
    export CARGO_TARGET_WASM32_UNKNOWN_UNKNOWN_LINKER=$rust/wasm-ld
    unset RUSTUP_TOOLCHAIN RUSTC_WRAPPER RUSTC_WORKSPACE_WRAPPER
    exec "$rust/usr/bin/cargo" "$@"
}

bindgen() {
    local own=$tools/wasm-bindgen-$bindgen_version/bin/wasm-bindgen
    if [ -x "$own" ]; then
        echo "$own"
    elif [ "$(wasm-bindgen --version 2>/dev/null)" = "wasm-bindgen $bindgen_version" ]; then
        command -v wasm-bindgen
    fi
}

setup_bindgen() {
    [ -z "$(bindgen)" ] || return 0
    local into=$tools/wasm-bindgen-$bindgen_version
    # Its test runner alone needs TLS. Little optimised, to be there sooner.
    CARGO_PROFILE_RELEASE_OPT_LEVEL=1 cargo install --quiet wasm-bindgen-cli --version "=$bindgen_version" \
        --no-default-features --bin wasm-bindgen --root "$into" --target-dir "$tools/wasm-bindgen-build" ||
        missing "wasm-bindgen $bindgen_version: cargo cannot install wasm-bindgen-cli"
    rm -rf "$tools/wasm-bindgen-build"
    say "compiled wasm-bindgen $bindgen_version"
}

# Of that version only, for promised sizes to hold.
optimiser() {
    local own=$tools/node_modules/binaryen
    if grep -qs "\"version\": \"$optimiser_version\"" "$own/package.json"; then
        echo "$own/bin/wasm-opt"
    elif [[ "$(wasm-opt --version 2>/dev/null)" =~ ^wasm-opt\ version\ ${optimiser_version%%.*}\  ]]; then
        command -v wasm-opt
    fi
}

# Into what npm has already installed there.
install_with_npm() {
    command -v node >/dev/null && command -v npm >/dev/null || missing "node and npm"
    mkdir -p "$tools"
    npm install --silent --no-audit --no-fund --prefix "$tools" "$@" || missing "$*, which npm cannot install"
}

setup_optimiser() {
    [ -n "$(optimiser)" ] || install_with_npm "binaryen@$optimiser_version"
}

# What the compiler may use, and nothing that it does not: wasm-opt goes by this, and answers stay what they are, to the bit.
optimise() {
    local features=(--enable-simd --enable-bulk-memory --enable-bulk-memory-opt --enable-nontrapping-float-to-int --enable-sign-ext
        --enable-mutable-globals --enable-reference-types --enable-multivalue)
    [ -z "${SPLITPLANE_WEB_SHARED:-}" ] || features+=(--enable-threads)
    "$(optimiser)" -O3 "${features[@]}" "$1" -o "$1"
}

setup_browser() {
    command -v node >/dev/null && command -v npm >/dev/null || missing "node and npm"
    if ! command -v chromium >/dev/null; then
        command -v apt-get >/dev/null || missing "chromium, and there is no apt-get to install it"
        as_root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends \
            -o DPkg::Lock::Timeout=300 chromium fonts-dejavu-core >/dev/null || missing "chromium, which apt-get cannot install"
        say "installed chromium"
    fi
    grep -qs "\"version\": \"$driver_version\"" "$tools/node_modules/playwright-core/package.json" ||
        install_with_npm "playwright-core@$driver_version"
}

check() {
    local ready=0
    if installed_has_target; then say "compiler: the installed one"; elif unpacked; then say "compiler: $tools/rust"; else
        say "missing: a compiler for $target"
        ready=1
    fi
    if [ -n "$(bindgen)" ]; then say "wasm-bindgen: $(bindgen)"; else
        say "missing: wasm-bindgen $bindgen_version"
        ready=1
    fi
    if [ -n "$(optimiser)" ]; then say "wasm-opt: $(optimiser)"; else
        say "missing: wasm-opt of binaryen $optimiser_version"
        ready=1
    fi
    local why
    why=$(can_share) || say "no modules for threads: $why"
    if command -v node >/dev/null; then say "node: $(node --version)"; else
        say "missing: node"
        ready=1
    fi
    if command -v chromium >/dev/null && [ -d "$tools/node_modules/playwright-core" ]; then
        say "browser: $(command -v chromium)"
    else
        say "no browser with its driver; tests in one are left out"
    fi
    return $ready
}

case ${1:-} in
setup)
    setup_rust
    setup_bindgen
    setup_optimiser
    [ "${2:-}" != --browser ] || setup_browser
    check
    ;;
check) check ;;
can-share) can_share ;;
cargo) shift && run_cargo "$@" ;;
bindgen)
    shift
    program=$(bindgen)
    [ -n "$program" ] || missing "wasm-bindgen $bindgen_version; run scripts/web.sh setup"
    "$program" "$@"
    ;;
optimise)
    [ -n "$(optimiser)" ] || missing "wasm-opt of binaryen $optimiser_version; run scripts/web.sh setup"
    optimise "$2"
    ;;
*)
    sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "${BASH_SOURCE[0]}"
    exit 2
    ;;
esac
