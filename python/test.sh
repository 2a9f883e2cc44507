#!/usr/bin/env bash
# Builds and tests the Python package: python/test.sh [--locked] [--gpu] [--release] [pytest's arguments]
#
# Makes a virtual environment under python/target and installs there, from PyPI, what the build and the tests need. Where that cannot
# be had, this says what is missing and tests nothing; with SPLITPLANE_PYTHON=required that is a failure.
# The wheel that is tested has no GPU backend unless --gpu is given, and is compiled with less optimisation unless --release is.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")"

say() { printf 'python/test.sh: %s\n' "$*"; }
absent() {
    say "$*"
    say "the Python package is not tested"
    [ "${SPLITPLANE_PYTHON:-}" != required ] || exit 1
    exit 0
}

profile=checked features=(--no-default-features) lock=() rest=()
for argument in "$@"; do
    case $argument in
    --gpu) features=() ;;
    --release) profile=release ;;
    --locked | --offline | --frozen) lock+=("$argument") ;;
    *) rest+=("$argument") ;;
    esac
done

[ "${SPLITPLANE_PYTHON:-}" != absent ] || absent "SPLITPLANE_PYTHON=absent is set"
python=${PYTHON:-python3}
command -v "$python" >/dev/null || absent "there is no $python"
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || absent "$python is older than 3.10"
venv=${SPLITPLANE_VENV:-$PWD/target/venv}
[ -x "$venv/bin/python" ] || "$python" -m venv "$venv" || absent "$python cannot make virtual environments (package python3-venv)"

# trimesh, scipy and rtree are for the classes of trimesh's shape, Dask for work on a cluster; without them their tests are skipped, and
# pytest says so.
log=$(mktemp)
trap 'rm -f "$log"' EXIT
pip=("$venv/bin/python" -m pip install --quiet --disable-pip-version-check)
need=('maturin>=1.16,<2' 'numpy>=1.24' 'pytest>=7' 'mypy>=1.10')
"${pip[@]}" "${need[@]}" >"$log" 2>&1 || {
    tail -n 3 "$log"
    absent "these cannot be installed: ${need[*]}"
}
more=('trimesh>=4' 'scipy>=1.10' 'rtree>=1')
"${pip[@]}" "${more[@]}" >"$log" 2>&1 || say "these cannot be installed, and tests that need them are skipped: ${more[*]}"
cluster=('dask[distributed]>=2024.8')
"${pip[@]}" "${cluster[@]}" >"$log" 2>&1 || {
    tail -n 3 "$log"
    say "this cannot be installed, and tests that need it are skipped: ${cluster[*]}"
    [ "${SPLITPLANE_PYTHON:-}" != required ] || exit 1
}

# The settings of whoever calls must not choose other plugins or options.
export PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 PYTHONDONTWRITEBYTECODE=1 CARGO_INCREMENTAL=0
unset PYTEST_ADDOPTS

say "format and lints"
cargo fmt --check
cargo clippy --quiet --profile "$profile" --all-targets ${features[@]+"${features[@]}"} ${lock[@]+"${lock[@]}"} -- -D warnings

say "the wheel"
wheels=target/wheels-$profile
rm -rf "$wheels"
PATH=$venv/bin:$PATH maturin build --quiet --profile "$profile" --features pyo3/extension-module ${features[@]+"${features[@]}"} \
    ${lock[@]+"${lock[@]}"} --interpreter "$venv/bin/python" --out "$wheels"
"${pip[@]}" --force-reinstall --no-deps "$wheels"/*.whl

say "types"
"$venv/bin/python" -m mypy --no-incremental --cache-dir=/dev/null python/splitplane

# The tests import what was installed: the sources are a folder deeper.
say "pytest ${rest[*]-}"
"$venv/bin/python" -m pytest -q -rs ${rest[@]+"${rest[@]}"}
