#!/usr/bin/env python3
"""Holds what the workspace costs to compile to scripts/compile_cost.json.

    scripts/compile_cost.py [LIBRARY]     checks counts; fails if one grew by more than a tenth
    scripts/compile_cost.py --write [LIBRARY]
    scripts/compile_cost.py --times       prints CPU seconds of whole builds from nothing (minutes)

Counts are of test programs, and of the functions and bytes of text of each instruction set in
LIBRARY, the shared library of the C interface that capi/test.sh builds (x86-64 Linux). They
depend on the compiler a little, and on nothing else. Times are printed and not judged.
"""
import collections
import json
import os
import pathlib
import platform
import re
import resource
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
GOLDEN = ROOT / "scripts/compile_cost.json"
LIBRARY = ROOT / "target/bindings/checked/libsplitplane.so"
HELLO = """use splitplane::{BackendKind, BuildOptions, Hit, Mesh, QueryOptions, Ray};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let positions = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
    let mesh = Mesh::indexed(&positions, &[[0, 1, 2]])?;
    let backend = BackendKind::Auto.open()?.backend;
    let tree = backend.build(&mesh, &BuildOptions::default())?;
    let rays = [Ray::new([0.25, 0.25, 5.0], [0.0, 0.0, -1.0]); 4];
    let mut hits = [Hit::MISS; 4];
    tree.closest_hits(&rays, &mut hits, &QueryOptions::default())?;
    println!("{:?}", hits[0]);
    Ok(())
}
"""


def output(*command, **options):
    return subprocess.run(command, check=True, capture_output=True, text=True, **options).stdout


def test_programs():
    """Integration test programs of the workspace: targets, not the files that they are made of."""
    metadata = json.loads(output("cargo", "metadata", "--locked", "--no-deps", "--format-version", "1", cwd=ROOT))
    return sum("test" in target["kind"] for package in metadata["packages"] for target in package["targets"])


def instruction_set(name):
    for own, title in (("avx512", "avx512"), ("avx2", "avx2"), ("sse2", "sse2")):
        if own in name.lower():
            return title
    # The least set runs its kernels by the trait's default function.
    if "simd::Simd::call" in name:
        return "sse2"
    return "rayon" if "rayon" in name else None


def text_by_set(library):
    sizes = collections.defaultdict(lambda: [0, 0])
    for line in output("nm", "-S", "-C", library).splitlines():
        match = re.match(r"\S+ ([0-9a-f]+) [tT] (.*)", line)
        if match and (own := instruction_set(match.group(2))):
            sizes[own][0] += 1
            sizes[own][1] += int(match.group(1), 16)
    return sizes


def counts(library):
    found = {"test programs": test_programs()}
    for own, (functions, text) in sorted(text_by_set(library).items()):
        found[f"{own} functions"], found[f"{own} bytes"] = functions, text
    found["library bytes"] = library.stat().st_size
    return found


def check(library, write):
    if not (library.exists() and platform.machine() == "x86_64" and sys.platform == "linux"):
        found = {"test programs": test_programs()}
        print(f"NOT COUNTED: text of kernels: there is no {library} for x86-64 Linux")
    else:
        found = counts(library)
    if write:
        GOLDEN.write_text(json.dumps(found, indent=4) + "\n")
    golden, failed = json.loads(GOLDEN.read_text()), []
    for name, value in found.items():
        before = golden.get(name, 0)
        print(f"{value:10}  {name} ({before} in {GOLDEN.name})")
        if value * 10 > before * 11:
            failed.append(name)
    if failed:
        sys.exit(f"FAILED: grew by more than a tenth: {', '.join(failed)}. If that is meant, run {sys.argv[0]} --write")


def cpu_seconds(command, folder, target):
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    environment = {**os.environ, "CARGO_TARGET_DIR": str(target), "CARGO_INCREMENTAL": "0"}
    subprocess.run(command, check=True, cwd=folder, env=environment, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def times():
    with tempfile.TemporaryDirectory() as scratch:
        scratch = pathlib.Path(scratch)
        hello = scratch / "hello"
        (hello / "src").mkdir(parents=True)
        (hello / "src/main.rs").write_text(HELLO)
        (hello / "Cargo.toml").write_text(
            '[package]\nname = "hello"\nversion = "0.1.0"\nedition = "2024"\n'
            f'[dependencies]\nsplitplane = {{ path = "{ROOT}" }}\n[workspace]\n')
        shutil.copy(ROOT / "Cargo.lock", hello / "Cargo.lock")
        output("cargo", "metadata", "--format-version", "1", cwd=hello)  # fetches
        build = ["cargo", "build", "--quiet"]
        cases = [
            ("hello, release", build + ["--release"], hello),
            ("hello, dev", build, hello),
            ("the program, release", build + ["--release", "--locked", "-p", "splitplane-cli"], ROOT),
            ("the Python module, release", build + ["--release", "--locked", "--features", "pyo3/extension-module"], ROOT / "python"),
        ]
        for number, (name, command, folder) in enumerate(cases):
            target = scratch / f"target{number}"
            print(f"{cpu_seconds(command, folder, target):8.1f} CPU s  {name}", flush=True)
            if name == "hello, release":
                program = target / "release/hello"
                output("strip", program)
                print(f"{program.stat().st_size:8} bytes  hello, stripped")
            shutil.rmtree(target)


if __name__ == "__main__":
    arguments = sys.argv[1:]
    if arguments == ["--times"]:
        times()
    else:
        paths = [pathlib.Path(path) for path in arguments if path != "--write"]
        check(paths[0] if paths else LIBRARY, "--write" in arguments)
