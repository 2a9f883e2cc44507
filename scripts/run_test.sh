#!/usr/bin/env bash
# Cargo's runner for scripts/test.sh: prints the time of each test.
#
# Stable Rust has the option in its test harness but accepts it only with RUSTC_BOOTSTRAP.
# A harness that refuses it runs without.
case $1 in
*/deps/*)
    if RUSTC_BOOTSTRAP=1 "$1" --list -Zunstable-options --report-time >/dev/null 2>&1; then
        RUSTC_BOOTSTRAP=1 exec "$@" -Zunstable-options --report-time
    fi
    ;;
esac
exec "$@"
