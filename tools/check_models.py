"""Explores the models of specs/models with Spin, and says of each run whether it came out as it must.

    python3 tools/check_models.py [--quick] [--only WORDS] [--seconds-max N]

needs nothing but Python, `spin` and `gcc`; without these it says so and ends with 77. `--quick` leaves out the long runs;
`--only` takes the runs whose names hold these words. Prints one row of a table for each run; ends with 1 if one came out wrong.
The runs are those of tools/model_runs.py. A mutant must fail an assertion, whatever else goes wrong there; every other run must
visit all states that there are, and find nothing.
"""

from __future__ import annotations

import argparse
import math
import re
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from model_runs import RUNS, Run

MODELS = Path(__file__).resolve().parents[1] / "specs" / "models"
MEMORY_MIB_MAX = 3800
"""Of one exploration; there is one at a time, so all of them stay within 4 GiB."""
QUICK_PROCESSOR_S_MAX = 180.0
"""Of all quick runs together, compilers included. Of processors and not of clocks, so that other tests at the same time do not count."""
SKIPPED = 77
NEEDED = ("spin", "gcc")


@dataclass(frozen=True)
class Found:
    """What an exploration came to."""

    states: int
    depth: int
    complaint: str
    is_complete: bool

    @property
    def is_failed_assertion(self) -> bool:
        return self.complaint.startswith("assertion violated") and "invalid array index" not in self.complaint


def read(text: str, ended: bool = True) -> Found:
    """The exploration's own words; `ended`: it was not cut off."""
    states = re.search(r"^\s*(\d+) states, stored", text, re.MULTILINE)
    depth = re.search(r"depth reached (\d+), errors: \d+", text)
    complaint = re.search(r"^pan:\d+: (.*?) \(at depth \d+\)", text, re.MULTILINE)
    cut = re.search(r"Search not completed|search depth too small|reached -DMEMLIM|out of memory", text)
    return Found(
        int(states[1]) if states else 0,
        int(depth[1]) if depth else 0,
        " ".join(complaint[1].split()) if complaint else "",
        ended and states is not None and not cut,
    )


def verdict(run: Run, found: Found) -> tuple[bool, str]:
    """Whether it came out as it must, and what is to be said of it."""
    if run.is_mutant:
        if found.is_failed_assertion:
            return True, "found"
        return False, found.complaint or ("NOT FOUND" if found.is_complete else "NOT FOUND, cut off")
    if found.complaint:
        return False, found.complaint
    return found.is_complete, "holds" if found.is_complete else "CUT OFF"


def explore(run: Run, seconds_max: float) -> Found:
    """Makes the explorer of a model, and runs it."""
    with tempfile.TemporaryDirectory() as folder:
        made = [
            ["spin", "-a", *run.flags.split(), str(MODELS / f"{run.model}.pml")],
            [
                "gcc",
                "-O0" if run.quick else "-O2",
                "-w",
                "-DSAFETY",
                "-DCOLLAPSE",
                f"-DMEMLIM={MEMORY_MIB_MAX}",
                "-o",
                "pan",
                "pan.c",
            ],
        ]
        for command in made:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
            if done.returncode:
                return Found(0, 0, f"{command[0]}: {(done.stdout + done.stderr).strip()[:300]}", False)
        command = ["./pan", f"-m{run.depth_max}", "-w20"]
        try:
            done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=seconds_max)
        except subprocess.TimeoutExpired:
            return Found(0, 0, "", is_complete=False)
        return read(done.stdout + done.stderr)


def processor_s() -> float:
    """What all programs that were run so far have used."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def check(runs: Sequence[Run], seconds_max: float, processor_s_max: float = math.inf) -> list[str]:
    """Explores one after the other, prints a row for each, and returns what came out wrong; ends if all together take more of the processor."""
    wrong, began, used_before = [], time.monotonic(), processor_s()
    print("| run | shows | states | depth | seconds | result |\n| --- | --- | --- | --- | --- | --- |")
    for run in runs:
        start = time.monotonic()
        found = explore(run, seconds_max)
        is_right, words = verdict(run, found)
        took = time.monotonic() - start
        print(f"| {run.name} | {run.shows} | {found.states:,} | {found.depth:,} | {took:.1f} | {words} |", flush=True)
        if not is_right:
            wrong.append(f"{run.name}: {words}")
        if (used := processor_s() - used_before) > processor_s_max:
            wrong.append(f"with {run.name} the runs have taken {used:.0f} s of the processor, and {processor_s_max:.0f} s are the most")
            break
    mutants, took = sum(run.is_mutant for run in runs), time.monotonic() - began
    print(f"\n{len(runs)} runs, {mutants} of them mutants, {took:.0f} s, {processor_s() - used_before:.0f} s of the processor")
    return wrong


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="only what continuous integration explores")
    parser.add_argument("--only", default="", metavar="WORDS", help="only runs whose names hold these words")
    parser.add_argument("--seconds-max", type=float, default=900.0, metavar="N", help="for one exploration")
    options = parser.parse_args()
    if lacking := [name for name in NEEDED if shutil.which(name) is None]:
        print(f"skipped: {' and '.join(lacking)} not found; on Debian: apt-get install {' '.join(lacking)}", file=sys.stderr)
        return SKIPPED
    runs = [run for run in RUNS if (run.quick or not options.quick) and options.only in run.name]
    if not runs:
        print(f"no run is called {options.only!r}", file=sys.stderr)
        return 2
    wrong = check(runs, options.seconds_max, QUICK_PROCESSOR_S_MAX if options.quick else math.inf)
    for line in wrong:
        print(f"wrong: {line}", file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
