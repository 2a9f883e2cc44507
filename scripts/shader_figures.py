#!/usr/bin/env python3
"""Holds what offline compilers say of the shaders against what is promised, and against what they said before.

    scripts/shader_figures.py REPORT.json            # exit code 1, and the reasons, where a shader is worse
    scripts/shader_figures.py REPORT.json --update   # takes the report as the new figures; refused where a promise is broken

REPORT is an object with the shaders by name, each an object with any of these numbers:

    aco.vgprs, aco.scratch, aco.instructions   ACO, the compiler of Mesa for AMD: vector registers of a lane, private bytes
                                               of a wave, instructions
    aco.fma, cuda.fma                          fused multiply-adds: only free operations may become such
    cuda.registers, cuda.stack                 ptxas for sm_90: registers and private bytes of a lane
    cuda.instructions
    swiftshader.seconds, swiftshader.mib       SwiftShader: time and memory to make the pipeline

The figures of before are docs/measurements/shaders.json. A shader that they do not have is held to the promises alone.
"""
import json
import pathlib
import sys

ROOT = pathlib.Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs/measurements/shaders.json"

# Most of each number, for every shader.
PROMISED = {"swiftshader.seconds": 5.0, "swiftshader.mib": 1024}
# And for those that trace the plain case.
LEAN = ["closest_hit", "any_hit", "closest_hit_compressed", "any_hit_compressed", "closest_hits", "shadow_hits",
        "shadow_hits_through_glass", "closest_hits_compressed", "shadow_hits_compressed",
        "shadow_hits_through_glass_compressed", "enter_instances"]
# These too, and take a ray into an instance's space besides.
LEAN_IN_INSTANCES = ["trace_instances"]
# Sixteen entries of a stack are private memory: 192 bytes of ptxas's stack, 48 of ACO's vector registers and the instructions
# that choose among them. In the memory of the workgroup they were none of it, and rays took 1.3 to 1.6 times as long on an H100.
# Setting slivers aside takes 8 vector registers and 370 instructions of ACO, and saves a second walk.
LEAN_PROMISED = {
    "aco.vgprs": 120,
    "aco.scratch": 0,
    "aco.instructions": 3450,
    "cuda.registers": 72,
    "cuda.stack": 200,
}
# Those that trace nothing but rays through the tree itself, and any hits through compressed nodes, keep to fewer.
LEANEST = ["closest_hit", "any_hit", "closest_hits", "shadow_hits", "any_hit_compressed", "shadow_hits_compressed"]
LEANEST_PROMISED = LEAN_PROMISED | {"aco.vgprs": 112, "cuda.registers": 64}
# The same with the stack in the memory of the workgroup, as adapters of AMD are given them: NAME.workgroup.
WORKGROUP = ".workgroup"
WORKGROUP_PROMISED = {"aco.vgprs": 64, "aco.scratch": 0, "aco.instructions": 2850}
# Through glass, and in instances, besides.
WORKGROUP_MORE_PROMISED = WORKGROUP_PROMISED | {"aco.vgprs": 72}
# Kernels of builds: of trees, of trees of points, of compressed nodes.
BUILDS = sorted(path.stem for folder in ("kernels", "point_build", "compress")
                for path in (ROOT / "shaders" / folder).glob("*.wgsl"))
BUILDS_PROMISED = {"aco.vgprs": 64, "aco.scratch": 0, "cuda.registers": 64, "cuda.stack": 64}
# How much of the earlier number a number may be; what times and memory are depends on the machine.
GROWTH = {
    "aco.vgprs": 1.0,
    "aco.scratch": 1.0,
    "aco.instructions": 1.05,
    "aco.fma": 1.0,
    "cuda.registers": 1.1,
    "cuda.stack": 1.0,
    "cuda.instructions": 1.05,
    "cuda.fma": 1.0,
}


def promised(name):
    """Most of each number of a shader."""
    lean, stack = name.removesuffix(WORKGROUP), name.endswith(WORKGROUP)
    if stack and lean in LEAN + LEAN_IN_INSTANCES:
        more = "through_glass" in lean or lean in LEAN_IN_INSTANCES
        return PROMISED | (WORKGROUP_MORE_PROMISED if more else WORKGROUP_PROMISED)
    if name in BUILDS:
        return PROMISED | BUILDS_PROMISED
    if name in LEANEST:
        return PROMISED | LEANEST_PROMISED
    if name in LEAN_IN_INSTANCES:
        return PROMISED | LEAN_PROMISED | {"aco.instructions": 3850}
    return PROMISED | (LEAN_PROMISED if name in LEAN else {})


def broken(report):
    """Promises that a report breaks."""
    needed = set(LEAN + LEAN_IN_INSTANCES + BUILDS)
    for name, shader in sorted(report.items()):
        for key, most in promised(name).items():
            found = shader.get(key)
            if found is None and name in needed and key.split(".")[0] in measured(report):
                yield f"{name}: there is no {key}"
            elif isinstance(found, str) or (found is not None and found > most):
                yield f"{name}: {key} is {found}, promised is at most {most}"
    for name in sorted(needed - report.keys()):
        yield f"{name}: not in the report"


def measured(report):
    """The compilers that said anything."""
    return {key.split(".")[0] for shader in report.values() for key in shader if "." in key}


def worse(report, before):
    """What is worse than before."""
    for name, shader in sorted(report.items()):
        for key, growth in GROWTH.items():
            old, new = before.get(name, {}).get(key), shader.get(key)
            if old is not None and new is not None and new > old * growth:
                yield f"{name}: {key} was {old} and is {new}"


def main():
    arguments = sys.argv[1:]
    update = "--update" in arguments
    paths = [argument for argument in arguments if argument != "--update"]
    if len(paths) != 1 or paths[0].startswith("-"):
        sys.exit(__doc__)
    report = json.loads(pathlib.Path(paths[0]).read_text())
    faults = list(broken(report))
    if not update and FIGURES.exists():
        faults += worse(report, json.loads(FIGURES.read_text()))
    for fault in faults:
        print(fault)
    if faults:
        sys.exit(1)
    if update:
        kept = {name: {key: shader[key] for key in sorted(shader) if "." in key} for name, shader in sorted(report.items())}
        FIGURES.write_text(json.dumps(kept, indent=1) + "\n")
    print(f"{len(report)} shaders are within what is promised")


main()
