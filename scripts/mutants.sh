#!/usr/bin/env bash
# Plants faults, one at a time, and tells which no test notices: scripts/mutants.sh core|cpu [arguments of cargo mutants]
#
# `core` plants them in the core, `cpu` in the CPU backend but for its vector code, where a fault is seldom one of a line.
# For instance `scripts/mutants.sh core --file 'core/src/validate.rs'`, or `--shard 0/16` for every sixteenth fault. Needs
# cargo-mutants (cargo install cargo-mutants --locked). A fault in the core takes some ten seconds, one in the CPU backend two minutes:
# all of them take days.
#
# A fault is held against the tests of its own package; what these do not notice is held against the tests of all packages but those that need
# a GPU. What neither notices is written to target/mutants/PACKAGE/survivors.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

which=${1:-}
case $which in
core) select=(-p splitplane-core) ;;
cpu) select=(-p splitplane-cpu --exclude 'backend-cpu/src/query/simd/**' --exclude 'backend-cpu/src/query/packet/**'
    --exclude 'backend-cpu/src/query/{fast,leaf,lines,prepare,refined,sieve,step,stream,watertight}.rs') ;;
*)
    sed -n 's/^# \{0,1\}//; 2,/^set/{/^set/!p}' "$0" >&2
    exit 2
    ;;
esac
shift

out=target/mutants/$which
mkdir -p "$out"
# Exit code 2 says that there are survivors, 3 that some ran out of time.
cargo mutants "${select[@]}" --output "$out/own" "$@" || [ $? -le 3 ]
missed=$out/own/mutants.out/missed.txt
if [ -s "$missed" ]; then
    # By their whole names.
    patterns=()
    while IFS= read -r name; do
        patterns+=(--re "^$(printf '%s' "$name" | sed 's/[][\.*^$+?(){}|]/\\&/g')\$")
    done <"$missed"
    cargo mutants "${select[@]}" --output "$out/others" --test-package splitplane-core --test-package splitplane-cpu \
        --test-package splitplane --test-package splitplane-fuzz-targets "${patterns[@]}" || [ $? -le 3 ]
    cp "$out/others/mutants.out/missed.txt" "$out/survivors"
else
    : >"$out/survivors"
fi
printf '%s faults survive: %s\n' "$(wc -l <"$out/survivors")" "$out/survivors"
