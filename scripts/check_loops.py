#!/usr/bin/env python3
"""No loop of dependencies among the packages of the workspace, those of their tests included.

Cargo refuses loops of normal and build dependencies, and lets dev-dependencies go round: a package is then
compiled twice, and a change anywhere in the loop compiles all of it again. Reads `cargo metadata`; exits
with 1 and names the loop where there is one.

Usage: scripts/check_loops.py [arguments of cargo metadata]
"""

import json
import subprocess
import sys


def edges(arguments):
    """For every package of the workspace the packages of the workspace that it depends on, by kind."""
    command = ["cargo", "metadata", "--no-deps", "--format-version", "1", *arguments]
    packages = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE).stdout)["packages"]
    names = {package["name"] for package in packages}
    return {
        package["name"]: {
            dependency["name"]: dependency["kind"] or "normal"
            for dependency in package["dependencies"]
            if dependency.get("path") and dependency["name"] in names
        }
        for package in packages
    }


def find_loop(graph):
    """The packages of a loop, the first one again at the end; empty where there is none."""
    done = set()
    for start in sorted(graph):
        # The way to the package that is looked at, with what is left to look at from each.
        way, left = [start], [iter(sorted(graph[start]))]
        while way:
            following = next(left[-1], None)
            if following is None:
                done.add(way.pop())
                left.pop()
            elif following in way:
                return way[way.index(following):] + [following]
            elif following not in done:
                way.append(following)
                left.append(iter(sorted(graph[following])))
    return []


def main():
    graph = edges(sys.argv[1:])
    loop = find_loop(graph)
    if loop:
        steps = [f"{a} -> {b} ({graph[a][b]})" for a, b in zip(loop, loop[1:])]
        print("a loop of dependencies:\n  " + "\n  ".join(steps), file=sys.stderr)
        return 1
    print(f"{len(graph)} packages, {sum(map(len, graph.values()))} dependencies among them, no loop")
    return 0


if __name__ == "__main__":
    sys.exit(main())
