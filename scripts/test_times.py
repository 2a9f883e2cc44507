#!/usr/bin/env python3
"""Prints where a test run spent its time.

    scripts/test_times.py LOG [--slow SECONDS]

LOG is what scripts/test.sh printed. Without options: seconds by program, then the 20 slowest tests.
With --slow: the names of tests that took longer, one a line, for scripts/slow_tests.txt.
"""
import argparse
import re

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
parser.add_argument("log")
parser.add_argument("--slow", type=float, metavar="SECONDS")
given = parser.parse_args()

RUNNING = re.compile(r"^\s+Running .*\((?:.*/)?deps/(\S+?)-[0-9a-f]{16}(?:\.exe)?\)|^\s+(Doc-tests) (\S+)")
TEST = re.compile(r"^test (.+?) \.\.\. .*<([0-9.]+)s>$")
RESULT = re.compile(r"^test result: .* (\d+) passed;.* finished in ([0-9.]+)s")

program, tests, programs = "?", [], {}
with open(given.log, encoding="utf-8", errors="replace") as lines:
    for line in lines:
        if match := RUNNING.match(line):
            program = match.group(1) or f"{match.group(3)} (documentation)"
        elif match := TEST.match(line):
            tests.append((float(match.group(2)), program, match.group(1)))
        elif match := RESULT.match(line):
            count, seconds = programs.get(program, (0, 0.0))
            programs[program] = count + int(match.group(1)), seconds + float(match.group(2))

tests.sort(reverse=True)
if given.slow is not None:
    names = sorted({name for seconds, _, name in tests if seconds > given.slow})
    print("\n".join(names))
else:
    total = sum(seconds for _, seconds in programs.values())
    print(f"{len(programs)} programs ran tests for {total:.0f} s:")
    for name, (count, seconds) in sorted(programs.items(), key=lambda row: -row[1][1]):
        if seconds >= 0.5:
            print(f"{seconds:8.1f} s {count:5} tests  {name}")
    print("\nThe 20 slowest tests:")
    for seconds, name, test in tests[:20]:
        print(f"{seconds:8.1f} s  {name}: {test}")
