#!/usr/bin/env bash
# Plants faults in the core, one at a time, and tells which no test notices: scripts/mutants.sh [arguments of cargo mutants]
#
# For instance `scripts/mutants.sh --file 'core/src/validate.rs'`, or `--shard 0/16` for every sixteenth fault. Needs cargo-mutants
# (cargo install cargo-mutants --locked). A fault takes about ten seconds, all of them half a day.
#
# A fault is held against the core's own tests, and if these do not notice it, against those of the CPU backend. What neither notices is
# written to target/mutants/survivors.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

out=target/mutants
mkdir -p "$out"
# Exit code 2 says that there are survivors, 3 that some ran out of time.
cargo mutants -p splitplane-core --output "$out/core" "$@" || [ $? -le 3 ]
cp "$out/core/mutants.out/missed.txt" "$out/missed"
if [ -s "$out/missed" ]; then
    # By their whole names.
    patterns=()
    while IFS= read -r name; do
        patterns+=(--re "^$(printf '%s' "$name" | sed 's/[][\.*^$+?(){}|]/\\&/g')\$")
    done <"$out/missed"
    cargo mutants -p splitplane-core --output "$out/cpu" --test-package splitplane-cpu "${patterns[@]}" || [ $? -le 3 ]
    cp "$out/cpu/mutants.out/missed.txt" "$out/survivors"
else
    : >"$out/survivors"
fi
printf '%s faults survive: %s\n' "$(wc -l <"$out/survivors")" "$out/survivors"
