#!/usr/bin/env bash
# Every public item of every library that is published, as lists in docs/public_api: what users may lean on.
#
#   scripts/public_api.sh             # fails and shows the difference where code and lists differ
#   scripts/public_api.sh --update    # writes the lists; commit them with the change that they show
#   scripts/public_api.sh --since REV # what has changed since a revision, as the lists say; builds nothing
#
# The lists come from rustdoc's JSON, whose form changes with the compiler: hence one nightly and one version
# of cargo-public-api, both named here and installed where they are missing.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

toolchain=${SPLITPLANE_API_TOOLCHAIN:-nightly-2026-05-20}
tool=0.52.0
lists=docs/public_api

case ${1:-} in
--since)
    git diff --stat "${2:?name a revision}" -- "$lists"
    git diff --unified=0 "$2" -- "$lists"
    exit
    ;;
'' | --update) ;;
*)
    sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
    exit 2
    ;;
esac

rustup toolchain list | grep -q "^$toolchain" ||
    rustup toolchain install "$toolchain" --profile minimal --no-self-update
[ "$(cargo public-api --version 2>/dev/null)" = "cargo-public-api $tool" ] ||
    cargo install --locked "cargo-public-api@$tool"

scratch=$(mktemp -d)
trap 'rm -rf "$scratch"' EXIT
for package in $(scripts/published.py | sed 's/^-p //'); do
    # Programs have no items to lean on.
    [ "$package" != splitplane-cli ] || continue
    # -sss leaves out what every type has or a derive gives: blanket, automatic and derived implementations.
    cargo "+$toolchain" public-api --package "$package" --all-features -sss >"$scratch/$package.txt" 2>"$scratch/log" || {
        cat "$scratch/log" >&2
        exit 1
    }
    [ -s "$scratch/$package.txt" ] || {
        echo "no public item was found in $package" >&2
        exit 1
    }
done

if [ "${1:-}" = --update ]; then
    mkdir -p "$lists"
    rm -f "$lists"/*.txt
    cp "$scratch"/*.txt "$lists"
elif ! diff --unified=0 --exclude=log --exclude='*.md' "$lists" "$scratch"; then
    echo "the public items differ from $lists; where the change is meant: scripts/public_api.sh --update" >&2
    exit 1
fi
wc -l "$lists"/*.txt
