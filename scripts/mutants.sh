#!/usr/bin/env bash
# Plants faults, one at a time, and tells which no test notices: scripts/mutants.sh core|cpu [arguments of cargo mutants]
#
# `core` plants them in the core, `cpu` in the CPU backend but for its vector code, where a fault is seldom one of a line.
# For instance `scripts/mutants.sh core --file 'core/src/tree/validate.rs'`, or `--sharding round-robin --shard 0/48` for every 48th
# fault. Needs cargo-mutants (cargo install cargo-mutants --locked). A fault in the core takes some ten seconds, one in the CPU backend two minutes:
# all of them take days.
#
# A fault is held against the tests of its own package; what these do not notice is held against the tests of all packages but those that need
# a GPU. What neither notices is written to target/mutants/PACKAGE/survivors, and what ran out of time.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

which=${1:-}
case $which in
core) select=(-p splitplane-core --exclude-re 'tests::') ;; # what test modules say is no part of it
cpu) select=(-p splitplane-cpu --exclude 'backend-cpu/src/simd/**' --exclude 'backend-cpu/src/trace/packet/**'
    --exclude 'backend-cpu/src/trace/{block_test,fast,prepare,ray_state,refined,sieve,step,stream,triangle_block,watertight}.rs') ;;
*)
    sed -n 's/^# \{0,1\}//; 2,/^set/{/^set/!p}' "$0" >&2
    exit 2
    ;;
esac
shift

out=target/mutants/$which
rm -rf "$out"
mkdir -p "$out"
# Exit code 2 says that there are survivors, 3 that some ran out of time; others that nothing was found out.
run() {
    local code=0
    cargo mutants "${select[@]}" "$@" || code=$?
    [ $code -eq 0 ] || [ $code -eq 2 ] || [ $code -eq 3 ] || exit $code
}
run --output "$out/own" "$@"
missed=$out/own/mutants.out/missed.txt
if [ -s "$missed" ]; then
    # By their whole names. cargo-mutants 27.1 plants every "delete field" fault whatever the names asked for: so their files too,
    # and the others are taken out below.
    patterns=()
    while IFS= read -r name; do
        patterns+=(--re "^$(printf '%s' "$name" | sed 's/[][\.*^$+?(){}|]/\\&/g')\$" --file "${name%%:*}")
    done <"$missed"
    run --output "$out/others" --test-package splitplane-core --test-package splitplane-cpu \
        --test-package splitplane --test-package splitplane-fuzz-targets "${patterns[@]}"
    { grep -Fxf "$missed" "$out/others/mutants.out/missed.txt" || true; } >"$out/survivors"
    cat "$out"/{own,others}/mutants.out/timeout.txt >>"$out/survivors"
else
    cp "$out/own/mutants.out/timeout.txt" "$out/survivors"
fi
printf '%s faults survive: %s\n' "$(wc -l <"$out/survivors")" "$out/survivors"
