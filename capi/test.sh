#!/usr/bin/env bash
# Builds and tests the C interface: capi/test.sh [--locked] [--gpu] [--release]
#
# The crate's own tests need Cargo alone. The programs in C and C++ need a compiler; AddressSanitizer, Valgrind, CMake and pkg-config are used where they are there. What is
# missing is said at the end; with SPLITPLANE_CAPI=required that is a failure. SPLITPLANE_CAPI=absent tests nothing.
# The library that is tested has no GPU backend unless --gpu is given, and is compiled with less optimisation unless --release is.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

say() { printf 'capi/test.sh: %s\n' "$*"; }
if [ "${SPLITPLANE_CAPI:-}" = absent ]; then
    say "SPLITPLANE_CAPI=absent is set"
    say "NOT TESTED: the C interface"
    exit 0
fi

profile=checked features=(--no-default-features) lock=()
for argument in "$@"; do
    case $argument in
    --gpu) features=() ;;
    --release) profile=release ;;
    --locked | --offline | --frozen) lock+=("$argument") ;;
    *)
        sed -n 2p "$0" >&2
        exit 2
        ;;
    esac
done
cpu=()
[ ${#features[@]} -eq 0 ] || cpu=(--cpu)

missing=()
absent() {
    say "NOT TESTED: $*"
    missing+=("$*")
}

export CARGO_INCREMENTAL=0
say "format and lints"
cargo fmt --check
cargo clippy --quiet --profile "$profile" --all-targets ${features[@]+"${features[@]}"} ${lock[@]+"${lock[@]}"} -- -D warnings

say "cargo test"
cargo test --quiet --profile "$profile" ${features[@]+"${features[@]}"} ${lock[@]+"${lock[@]}"}

case $(uname -s) in
MINGW* | MSYS* | CYGWIN*)
    say "NOT TESTED: install.sh and the programs in C and C++: they are for Unix systems"
    exit 0
    ;;
esac

say "installing"
target=${CARGO_TARGET_DIR:-$PWD/target}
prefix=$target/prefix
scratch=$target/programs
rm -rf "$prefix" "$scratch"
mkdir -p "$scratch"
./install.sh "$prefix" --profile "$profile" ${cpu[@]+"${cpu[@]}"} ${lock[@]+"${lock[@]}"}
export PKG_CONFIG_PATH=$prefix/lib/pkgconfig LD_LIBRARY_PATH=$prefix/lib DYLD_LIBRARY_PATH=$prefix/lib

cc=${CC:-cc} cxx=${CXX:-c++}
strict=(-Wall -Wextra -Werror -Wpedantic -g)
flags=(-I"$prefix/include" -L"$prefix/lib" -lsplitplane)
if command -v pkg-config >/dev/null; then
    read -ra flags <<<"$(pkg-config --cflags --libs splitplane)"
else
    absent "the pkg-config file: there is no pkg-config"
fi

# The guide's page: its first block stands outside of the program's function, the others follow one another in it.
page=../docs/guide/src/c.md
awk -v page="$page" '
    /^```c$/ { inside = 1; if (++blocks == 2) print "int main(void) {"; printf "#line %d \"%s\"\n", NR + 1, page; next }
    /^```/ { inside = 0 }
    inside { print }
    END { if (blocks < 2) exit 1; print "return 0;\n}" }
' "$page" >"$scratch/page.c"
# The page that begins with nothing has one whole program.
awk -v page="${page%/c.md}/first.md" '
    /^```c$/ { inside = 1; printf "#line %d \"%s\"\n", NR + 1, page; next }
    /^```/ { inside = 0 }
    inside { print }
' "${page%/c.md}/first.md" >"$scratch/first.c"
# Every status stands on the page, with its number.
grep -o 'SPLITPLANE_STATUS_[A-Z_]* = [0-9]*' include/splitplane.h | while read -r name _ number; do
    grep -qF "| \`$name\` | $number |" "$page" || {
        say "$page does not say that $name is $number"
        exit 1
    }
done

# Each program: its name, its source, and what it is run with.
programs=(first page picture shapes scene misuse lives)
source_of() {
    case $1 in
    first | page) echo "$scratch/$1.c" ;;
    picture | shapes) echo "examples/$1.c" ;;
    scene) echo examples/scene.cpp ;;
    *) echo "tests/$1.c" ;;
    esac
}
compile() { # compile PROGRAM OUT FLAGS...
    local source out=$2
    source=$(source_of "$1")
    shift 2
    case $source in
    *.cpp) "$cxx" -std=c++17 "${strict[@]}" "$@" "$source" -o "$out" "${flags[@]}" ;;
    *) "$cc" -std=c11 "${strict[@]}" "$@" "$source" -o "$out" "${flags[@]}" -lm -lpthread ;;
    esac
}
# Runs a program in the scratch folder: run ROUNDS COMMAND...; what it says is shown where it fails.
limit=()
! command -v timeout >/dev/null || limit=(timeout 300)
run() {
    local rounds=$1 words=() name
    shift
    name=$(basename "${!#}")
    case $name in
    lives*) words=("$rounds") ;;
    misuse*) words=("$scratch") ;;
    esac
    if (cd "$scratch" && ${limit[@]+"${limit[@]}"} "$@" ${words[@]+"${words[@]}"}) >"$scratch/$name.log" 2>&1; then
        case $name in
        lives* | misuse*) tail -n 1 "$scratch/$name.log" ;;
        esac
    else
        tail -n 60 "$scratch/$name.log"
        say "FAILED: $*"
        exit 1
    fi
}
# Whether the compilers make and run programs with these flags.
works() {
    printf 'int main(void) { return 0; }\n' >"$scratch/probe.c"
    cp "$scratch/probe.c" "$scratch/probe.cpp"
    command -v "$cc" >/dev/null && command -v "$cxx" >/dev/null && "$cc" "$@" "$scratch/probe.c" -o "$scratch/probe" 2>/dev/null &&
        "$cxx" "$@" "$scratch/probe.cpp" -o "$scratch/probe" 2>/dev/null && "$scratch/probe"
}

if ! works; then
    absent "the programs in C and C++: there is no compiler ($cc, $cxx)"
else
    say "programs in C11 and C++17"
    for program in "${programs[@]}"; do
        compile "$program" "$scratch/$program"
        run 10000 "$scratch/$program"
    done
    # What is planted is found.
    fails() { # fails STATUS COMMAND...
        local expected=$1 status=0
        shift
        (cd "$scratch" && "$@") >"$scratch/planted.log" 2>&1 || status=$?
        [ "$status" -eq "$expected" ] || {
            tail -n 20 "$scratch/planted.log"
            say "FAILED: status $status of $*, which has to be $expected"
            exit 1
        }
    }
    fails 1 "$scratch/lives" 2000 leak
    fails 1 "$scratch/misuse" "$scratch" planted
    say "a program with the static library"
    # What it needs besides is what the pkg-config file says.
    read -ra private <<<"$(sed -n 's/^Libs.private: //p' "$prefix/lib/pkgconfig/splitplane.pc")"
    "$cc" -std=c11 "${strict[@]}" -I"$prefix/include" examples/picture.c "$prefix/lib/libsplitplane.a" "${private[@]}" -o "$scratch/static"
    run 0 "$scratch/static"
    cmp "$scratch/static.log" "$scratch/picture.log"

    sanitize=(-fsanitize=address,undefined -fno-sanitize-recover=all -O1)
    if works "${sanitize[@]}"; then
        say "AddressSanitizer"
        printf '%s\n' '#include <splitplane.h>' 'int main(void) {' 'splitplane_query_options options;' \
            'return (int)splitplane_query_options_init(&options, sizeof options) + ((const volatile unsigned char *)&options)[sizeof options + 8];' '}' >"$scratch/planted.c"
        "$cc" -std=c11 "${sanitize[@]}" "$scratch/planted.c" -o "$scratch/planted" "${flags[@]}"
        fails 1 "$scratch/planted"
        for program in "${programs[@]}"; do
            compile "$program" "$scratch/$program-asan" "${sanitize[@]}"
            run 300 "$scratch/$program-asan"
        done
    else
        absent "programs under AddressSanitizer: the compiler has none"
    fi

    # Valgrind does not know AVX-512, so the portable instruction set answers there.
    if command -v valgrind >/dev/null; then
        say "Valgrind"
        printf '%s\n' '#include <splitplane.h>' '#include <stdlib.h>' 'int main(void) {' 'unsigned char *bytes = malloc(8);' \
            'splitplane_backend backend;' 'return bytes[4] ? (int)splitplane_backend_open("no", NULL, &backend) : 0;' '}' >"$scratch/planted.c"
        "$cc" -std=c11 "$scratch/planted.c" -o "$scratch/planted" "${flags[@]}"
        fails 99 valgrind --quiet --error-exitcode=99 "$scratch/planted"
        for program in "${programs[@]}"; do
            SPLITPLANE_ISA=portable run 20 valgrind --quiet --error-exitcode=99 --leak-check=full --show-leak-kinds=definite --errors-for-leak-kinds=definite --fair-sched=yes \
                "$scratch/$program"
        done
    else
        absent "programs under Valgrind: there is no valgrind"
    fi

    if command -v cmake >/dev/null; then
        say "CMake"
        cmake -S tests/cmake -B "$scratch/cmake" -DCMAKE_PREFIX_PATH="$prefix" -DCMAKE_C_COMPILER="$cc" -DCMAKE_CXX_COMPILER="$cxx" >"$scratch/cmake.log" 2>&1 &&
            cmake --build "$scratch/cmake" >>"$scratch/cmake.log" 2>&1 || {
            tail -n 40 "$scratch/cmake.log"
            exit 1
        }
        run 0 "$scratch/cmake/picture"
        run 0 "$scratch/cmake/scene"
    else
        absent "the CMake package: there is no cmake"
    fi
fi

if [ ${#missing[@]} -gt 0 ]; then
    say "${#missing[@]} not tested:"
    printf '    %s\n' "${missing[@]}"
    [ "${SPLITPLANE_CAPI:-}" != required ] || exit 1
fi
say "passed"
