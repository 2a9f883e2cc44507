#!/usr/bin/env python3
"""Checks the facade and the crates below it with no feature, with each alone, and with all.

    scripts/features.py [PACKAGE...]

Without packages: all that embedders use. Needs nothing but cargo.
"""
import json
import subprocess
import sys

EMBEDDED = [
    "splitplane-core", "splitplane-float-state", "splitplane-shaders", "splitplane-cpu", "splitplane-wgpu",
    "splitplane-render", "splitplane-scene", "splitplane-verify", "splitplane",
]

metadata = subprocess.run(
    ["cargo", "metadata", "--locked", "--no-deps", "--format-version", "1"],
    check=True, capture_output=True, text=True,
).stdout
features = {package["name"]: sorted(package["features"]) for package in json.loads(metadata)["packages"]}

for package in sys.argv[1:] or EMBEDDED:
    own = [name for name in features[package] if name != "default"]
    choices = [[]] + [[name] for name in own] + ([own] if len(own) > 1 else [])
    for choice in choices:
        what = ",".join(choice) or "no feature"
        command = ["cargo", "check", "--quiet", "--locked", "-p", package, "--no-default-features"]
        if choice:
            command += ["--features", ",".join(choice)]
        print(f"{package}: {what}", flush=True)
        # A warning in some combination of features is a mistake as well.
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
        if done.returncode or "warning" in done.stderr:
            sys.stderr.write(done.stderr)
            sys.exit(f"FAILED: {package} with {what}")
