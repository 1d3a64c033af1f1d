"""Scenefold beside Tahoe-LAFS on one machine, in turns within the same minutes.

    python benchmarks/beside_tahoe.py --turns 3

Both keep three copies of everything on five nodes, encrypted by the client, any one of which is enough. Of Tahoe-LAFS: three shares
of which one is needed. One file of 64 MiB up and down, then files of 8 KiB one by one, through its web interface; Scenefold by
`scenectl bench store`. All bytes are compared. Medians of the turns count; the ratio of what a turn measured says most.

Ends with 77 and a reason if Tahoe-LAFS cannot be had here.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from tahoe_grid import VERSION, CannotBe, Grid, GridFailed, grid, installed

MIB = 1 << 20
SMALL_BYTES = 8 * 1024
NODES, COPIES = 5, 3
SKIPPED = 77
FAILURES_MAX = 3
GOALS = {"up": 1.5, "down": 1.5, "small_puts": 30.0, "small_gets": 30.0}
OURS = {"up": "write_mib_s", "down": "read_mib_s", "small_puts": "small_writes_per_s", "small_gets": "small_reads_per_s"}
UNITS = {"up": "MiB/s", "down": "MiB/s", "small_puts": "records/s", "small_gets": "records/s"}


def main() -> int:
    options = _options()
    scenectl = shutil.which(options.scenectl)
    if scenectl is None:
        print(f"skipped: there is no program {options.scenectl}; name it with --scenectl", file=sys.stderr)
        return SKIPPED
    with tempfile.TemporaryDirectory(prefix="beside-tahoe-") as place:
        folder = Path(place)
        try:
            tahoe = installed(Path(options.tahoe) if options.tahoe else folder / "environment")
            with grid(tahoe, folder, NODES, COPIES, needed=1, happy=COPIES) as theirs:
                turns = list(_turns(theirs, scenectl, options))
        except CannotBe as problem:
            print(f"skipped: Tahoe-LAFS {VERSION} cannot be measured here: {problem}", file=sys.stderr)
            return SKIPPED
    report = _report(turns, options)
    print(json.dumps(report, indent=2) if options.json else _text(report))
    return 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--turns", type=int, default=3, help="how often both take turns")
    parser.add_argument("--mib", type=int, default=64, help="MiB up and down")
    parser.add_argument("--small", type=int, default=300, help="files of 8 KiB for Tahoe-LAFS, which stores some dozens a second")
    parser.add_argument("--small-records", type=int, default=4096, help="records of 8 KiB for Scenefold")
    parser.add_argument("--callers", type=int, default=4, help="small files at a time for Tahoe-LAFS")
    parser.add_argument("--tahoe", help="environment of Tahoe-LAFS, made there if there is none, and kept; by default a temporary one")
    parser.add_argument(
        "--scenectl", default=str(Path(sys.executable).with_name("scenectl")), help="the program; by default beside this Python"
    )
    parser.add_argument("--ports", help="ports of Scenefold's nodes, LOW,HIGH")
    parser.add_argument("--json", action="store_true")
    return parser.parse_args()


def _turns(theirs: Grid, scenectl: str, options: argparse.Namespace) -> Iterator[dict[str, dict[str, float]]]:
    """Both, one after the other. On a busy machine a grid may lose its nodes for a while: it is measured once more then, and that is said."""
    failures = 0
    for _ in range(options.turns):
        while True:
            theirs.wait_for(NODES)
            try:
                measured = _measure_tahoe(theirs, options)
                break
            except GridFailed as problem:
                failures += 1
                print(f"Tahoe-LAFS failed, and is measured once more: {problem}", file=sys.stderr)
                if failures > FAILURES_MAX:
                    raise CannotBe(f"it failed {failures} times: {problem}") from problem
        yield {"tahoe": measured, "scenefold": _measure_ours(scenectl, options)}


def _measure_tahoe(theirs: Grid, options: argparse.Namespace) -> dict[str, float]:
    data = os.urandom(options.mib * MIB)
    [cap], up = theirs.many(1, [partial(theirs.up, data)])
    [read], down = theirs.many(1, [partial(theirs.down, cap)])
    files = [os.urandom(SMALL_BYTES) for _ in range(options.small)]
    caps, small_puts = theirs.many(options.callers, [partial(theirs.up, file) for file in files])
    reads, small_gets = theirs.many(options.callers, [partial(theirs.down, one) for one in caps])
    if read != data or reads != files:
        raise SystemExit("Tahoe-LAFS gave other bytes than it was given")
    return {"up": options.mib * up, "down": options.mib * down, "small_puts": small_puts, "small_gets": small_gets}


def _measure_ours(scenectl: str, options: argparse.Namespace) -> dict[str, float]:
    command = [scenectl, "bench", "store", "--nodes", str(NODES), "--copies", str(COPIES), "--mib", str(options.mib), "--json"]
    command += ["--small-records", str(options.small_records), *(["--ports", options.ports] if options.ports else [])]
    environment = {name: value for name, value in os.environ.items() if name != "SCENEFOLD_PROFILE"}
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False, env=environment)
    if done.returncode:
        raise SystemExit(f"scenectl bench store ended with {done.returncode}")
    report = json.loads(done.stdout)
    found = {what: float(report[key]) for what, key in OURS.items()}
    return found | {"up_all_copies": float(report["copied_mib_s"] or 0), "copies_found": float(report["copies_found"])}


def _report(turns: list[dict[str, dict[str, float]]], options: argparse.Namespace) -> dict[str, object]:
    def of(who: str, what: str) -> list[float]:
        return [turn[who][what] for turn in turns]

    compared = {}
    for what, goal in GOALS.items():
        ratios = [ours / theirs for ours, theirs in zip(of("scenefold", what), of("tahoe", what), strict=True)]
        compared[what] = {
            "tahoe": statistics.median(of("tahoe", what)),
            "scenefold": statistics.median(of("scenefold", what)),
            "ratio": statistics.median(ratios),
            "ratio_range": [min(ratios), max(ratios)],
            "goal": goal,
        }
    return {
        "tahoe_version": VERSION,
        "nodes": NODES,
        "copies": COPIES,
        "mib": options.mib,
        "compared": compared,
        "up_all_copies_mib_s": statistics.median(of("scenefold", "up_all_copies")),
        "copies_found": min(of("scenefold", "copies_found")),
        "turns": turns,
    }


def _text(report: Mapping[str, object]) -> str:
    compared = report["compared"]
    assert isinstance(compared, dict)
    lines = [f"{'':12}{'Tahoe-LAFS':>12}{'Scenefold':>12}{'ratio':>8}  {'of turns':14}goal"]
    for what, row in compared.items():
        low, high = row["ratio_range"]
        name, turns = what.replace("_", " "), f"{low:.1f} to {high:.1f}"
        lines.append(
            f"{name:12}{row['tahoe']:12,.1f}{row['scenefold']:12,.1f}{row['ratio']:8.1f}  {turns:14}{row['goal']:g} ({UNITS[what]})"
        )
    lines.append(
        f"Scenefold, until all copies were there: {report['up_all_copies_mib_s']:,.1f} MiB/s up; copies found: {report['copies_found']}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    raise SystemExit(main())
