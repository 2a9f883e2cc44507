#!/usr/bin/env python3
"""Prints `-p NAME` for every package of the workspace that is published."""
import json
import subprocess

command = ["cargo", "metadata", "--locked", "--no-deps", "--format-version", "1"]
metadata = subprocess.run(command, check=True, capture_output=True, text=True).stdout
for package in json.loads(metadata)["packages"]:
    if package["publish"] is None:
        print("-p", package["name"])
