#!/usr/bin/env python3
"""Measures splitplane beside Embree 4, in turns within one process, and prints the tables of docs/performance.md.

    python3 scripts/measure_embree.py [options] SCENE.obj...

Embree's library is a shared library of version 4, from a package of the system, from https://github.com/RenderKit/embree/releases, or
out of the wheel `embreex` of PyPI (`pip download --no-deps embreex`, then unzip it: the library lies in embreex.libs, and the folder
must be in LD_LIBRARY_PATH too). Without Embree the program says what the loader could not find. Six of the scenes are written by
scripts/scenes.py; docs/performance.md says what the others are.

Times are CPU time. On a busy machine a ratio repeats to some 8 %: leave the machine alone, or take more rounds.
"""

import argparse
import pathlib
import re
import subprocess
import sys

SETS = ["primary", "shadow", "bounce", "chords"]


def lines(program, arguments):
    """What the measuring program prints, shown as it comes."""
    command = [program, *arguments]
    print(" ".join(map(str, command)), file=sys.stderr)
    run = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    for line in run.stdout:
        print(line.rstrip(), file=sys.stderr)
        yield line
    if run.wait():
        sys.exit(f"FAILED: {program} ended with exit code {run.returncode}")


def scene_of(line):
    """The scene that a line begins, with its triangles."""
    found = re.match(r"(\S+): (\d+) triangles, ", line)
    return found and (pathlib.Path(found[1]).stem, int(found[2]))


def rays(printed):
    """By scene: for closest and any hits, by set, our best preset's rate over Embree's."""
    found, scene = {}, None
    for line in printed:
        scene = scene_of(line) or scene
        one = re.match(r"\s+(\w+) (closest|any)\s+Embree [\d.]+ ns(.*)", line)
        if one:
            ratios = [float(ratio) for ratio in re.findall(r"[\d.]+ ns, ([\d.]+)", one[3])]
            found.setdefault(scene, {})[one[1], one[2]] = max(ratios)
    return found


def builds(printed):
    """By scene and preset: our first build over Embree's."""
    found, scene = {}, None
    for line in printed:
        scene = scene_of(line) or scene
        one = re.match(r"\s+build (\w+)\s+Embree.* first [\d.]+ ms, ([\d.]+)", line)
        if one:
            found.setdefault(scene, {})[one[1]] = float(one[2])
    return found


def shown(ratio):
    """A ratio; bold where Embree is ahead."""
    return f"**{ratio:.2f}**" if ratio < 1 else f"{ratio:.2f}"


def main():
    """Runs the program three times and prints two tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--library", default="libembree4.so.4", help="Embree's library (default: %(default)s)")
    parser.add_argument("--program", help="splitplane-embree; built in release where it is not given")
    parser.add_argument("--rays", default="32768", help="rays of each set (default: %(default)s)")
    parser.add_argument("--rounds", default="5", help="rounds, of which the median counts (default: %(default)s)")
    parser.add_argument("--no-avx2", action="store_true", help="leave out the table of both held to AVX2")
    parser.add_argument("scenes", nargs="+")
    options = parser.parse_args()
    program = options.program
    if program is None:
        root = pathlib.Path(__file__).resolve().parent.parent
        subprocess.run(["cargo", "build", "--locked", "--release", "-p", "splitplane-embree"], cwd=root, check=True)
        program = root / "target/release/splitplane-embree"
    common = ["--library", options.library, *options.scenes]
    measure = ["--presets", "fast,best", "--rays", options.rays, "--rounds", options.rounds, *common]
    built = builds(lines(program, ["--builds", "--presets", "fast,balanced,best", "--rounds", "3", *common]))
    for avx2 in [[]] if options.no_avx2 else [[], ["--avx2"]]:
        found = rays(lines(program, avx2 + measure))
        print("\nOur rate over Embree's, both held to AVX2\n" if avx2 else "\nOur rate over Embree's; of builds our time over Embree's\n")
        last = "" if avx2 else " build: `fast` / `balanced` / `best` |"
        print(f"| scene, triangles | closest hit: primary / shadow / bounce / chords | any hit: the same |{last}")
        print("|---|---|---|" if avx2 else "|---|---|---|---|")
        for (name, triangles), ratios in found.items():
            cells = [" / ".join(shown(ratios[one, kind]) for one in SETS) for kind in ["closest", "any"]]
            if not avx2:
                cells.append(" / ".join(f"{ratio:.1f}" for ratio in built[name, triangles].values()))
            print(f"| {name}, {triangles} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
