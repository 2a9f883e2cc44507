#!/usr/bin/env bash
# Builds the wheel that is published and checks it: python/wheel.sh [--cpu] [--locked]
#
# The wheel is for any Linux on x86-64 with glibc 2.17 or newer (manylinux2014) and CPython 3.10 or newer (abi3). It is linked by Zig, so that it asks
# for no newer glibc than that, whatever this machine has. Then its tags are checked, by name and by auditwheel, and it is installed from nothing into a
# virtual environment, where scripts/smoke.py runs from another folder. It ends with the wheel's path. --cpu leaves the GPU backend out.
# Tools come from PyPI: maturin, ziglang, auditwheel.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

say() { printf 'python/wheel.sh: %s\n' "$*"; }
fail() {
    say "$*" >&2
    exit 1
}

options=()
for argument in "$@"; do
    case $argument in
    --cpu) options+=(--no-default-features) ;;
    --locked | --offline | --frozen) options+=("$argument") ;;
    *) fail "there is no option $argument" ;;
    esac
done
[ "$(uname -s)-$(uname -m)" = Linux-x86_64 ] || fail "this builds wheels for Linux on x86-64, and only there"

python=${PYTHON:-python3}
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || fail "$python is older than 3.10"
work=$PWD/target/manylinux
tools=$work/tools wheels=$work/wheels fresh=$work/fresh
pip() { "$1/bin/python" -m pip install --quiet --disable-pip-version-check "${@:2}"; }

[ -x "$tools/bin/python" ] || "$python" -m venv "$tools"
pip "$tools" 'maturin>=1.16,<2' 'ziglang>=0.13,<0.16' 'auditwheel>=6,<7'

say "the wheel"
rm -rf "$wheels" "$fresh"
# Zig is found as a module of the Python that stands first.
PATH=$tools/bin:$PATH CARGO_INCREMENTAL=0 "$tools/bin/maturin" build --release --zig --compatibility manylinux2014 \
    --features pyo3/extension-module ${options[@]+"${options[@]}"} --interpreter "$tools/bin/python" --out "$wheels"
found=("$wheels"/*.whl)
[ ${#found[@]} = 1 ] && [ -f "${found[0]}" ] || fail "there is not one wheel: ${found[*]}"
wheel=${found[0]}

say "its tags"
case $(basename "$wheel") in
splitplane-*-cp310-abi3-manylinux2014_x86_64.manylinux_2_17_x86_64.whl) ;;
splitplane-*-cp310-abi3-manylinux_2_17_x86_64.manylinux2014_x86_64.whl) ;;
*) fail "the wheel has the name $(basename "$wheel")" ;;
esac
"$tools/bin/python" - "$wheel" <<'PYTHON'
import sys, zipfile

with zipfile.ZipFile(sys.argv[1]) as wheel:
    names = wheel.namelist()
    (about,) = [name for name in names if name.endswith(".dist-info/WHEEL")]
    lines = wheel.read(about).decode().splitlines()
tags = {line.split(": ", 1)[1] for line in lines if line.startswith("Tag: ")}
wanted = {"cp310-abi3-manylinux_2_17_x86_64", "cp310-abi3-manylinux2014_x86_64"}
assert tags == wanted, f"its tags are {sorted(tags)}"
libraries = [name for name in names if ".so" in name]
assert libraries == ["splitplane/_native.abi3.so"], f"its libraries are {libraries}"
for name in ["splitplane/__init__.py", "splitplane/py.typed", "splitplane/_native.pyi"]:
    assert name in names, f"it has no {name}"
PYTHON

say "what auditwheel says"
"$tools/bin/auditwheel" show "$wheel" | tee "$work/auditwheel.txt"
# The oldest glibc that its symbols allow, which may be older than was asked for.
"$tools/bin/python" - "$work/auditwheel.txt" <<'PYTHON'
import re, sys

text = " ".join(open(sys.argv[1]).read().split())
found = re.search(r'consistent with the following platform tag: "manylinux_2_(\d+)_x86_64"', text)
assert found and int(found[1]) <= 17, "auditwheel does not find it fit for manylinux_2_17_x86_64"
PYTHON

say "installed from nothing"
"$python" -m venv "$fresh"
pip "$fresh" "$wheel"
smoke=$PWD/scripts/smoke.py
(cd / && "$fresh/bin/python" -I -W error "$smoke")
say "well: $wheel ($(wc -c <"$wheel") bytes)"
