"""`python -m scenefold.simulation`: run seeds, or one again (docs/how-to/simulate.md).

Progress goes to stderr. On stdout comes a summary, or with --json one object with the keys `seeds` (how many were run),
`violations` (a list), `faults` (how many took effect, by kind) and `operations` (acknowledged ones). The exit code is 1 if
anything was violated, 2 for wrong usage.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from scenefold.simulation.crowd import run_all, run_one
from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import WORKLOADS, Order, Result
from scenefold.simulation.shrink import shorten
from scenefold.simulation.weather import STORM_S

HELD, VIOLATED, WRONG_USAGE = range(3)
NODES_MIN, NODES_MAX = 3, 64
SECONDS_MIN = 20.0
STORIES_MAX = 3
"""Stories that are shortened and told in full; of further violations one line each."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments say; the process's exit code."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.keep is not None and options.replay is None:
        parser.error("--keep is for one seed: give --replay")
    seeds = [options.replay] if options.replay is not None else list(options.seeds)
    orders = [
        Order(
            seed, options.nodes, options.workload, options.mutant, options.seconds, options.keep, options.trace if len(seeds) == 1 else None
        )
        for seed in seeds
    ]
    if options.keep is not None and max(options.keep, default=-1) >= len(replace(orders[0], keep=None).schedule):
        parser.error("--keep names a fault that this seed does not have")
    results: list[Result] = []
    for result in run_all(orders, min(options.jobs, len(orders))):
        results.append(result)
        _say(f"{len(results)}/{len(orders)} {_line_of(result)}")
    results.sort(key=lambda result: result.order.seed)
    failed = [result for result in results if result.violations]
    for result in failed[:STORIES_MAX]:
        _say("\n" + (_shortened(result) if options.shorten else result).story)
    _report(results, as_json=options.json)
    return VIOLATED if failed else HELD


def _shortened(result: Result) -> Result:
    """The same seed with as few faults as still violate the same law."""
    law, order = result.violations[0].law, result.order
    numbers = tuple(range(len(result.schedule))) if order.keep is None else order.keep
    found = {numbers: result}

    def fails(keep: tuple[int, ...]) -> bool:
        again = found[keep] = run_one(replace(order, keep=keep, trace_file=None))
        violated = any(violation.law == law for violation in again.violations)
        _say(f"  {len(keep)} faults: {'still ' + law if violated else 'holds'}")
        return violated

    _say(f"seed {order.seed}: looking for the fewest of {len(numbers)} faults that still violate: {law}")
    return found[shorten(numbers, fails).items]


def _report(results: Sequence[Result], *, as_json: bool) -> None:
    faults = Counter[str]()
    for result in results:
        faults.update(result.faults)
    operations = sum(result.operations for result in results)
    violations = [
        {"seed": result.order.seed, "law": found.law, "what": found.what, "at_s": round(found.at_s, 6), "replay": result.order.replay}
        for result in results
        for found in result.violations
    ]
    if as_json:
        document = {"seeds": len(results), "violations": violations, "faults": dict(sorted(faults.items())), "operations": operations}
        sys.stdout.write(json.dumps(document, indent=2) + "\n")
        return
    lines = [f"{len(results)} seeds, {operations} acknowledged operations, {faults.total()} faults, {len(violations)} violations"]
    lines += [f"  {count:7d}  {kind}" for kind, count in sorted(faults.items())]
    lines += [f"seed {one['seed']}: {one['law']}: {_first_line(one['what'])}\n  {one['replay']}" for one in violations]
    sys.stdout.write("\n".join(lines) + "\n")


def _line_of(result: Result) -> str:
    what = f"seed {result.order.seed}: {result.operations} operations, {sum(result.faults.values())} faults"
    counts = ", ".join(f"{count} {name}" for name, count in sorted(result.counts.items()))
    verdict = f" VIOLATED {result.violations[0].law}: {_first_line(result.violations[0].what)}" if result.violations else ""
    return f"{what}, {counts}, {result.virtual_s:.0f} s in {result.cpu_s:.2f} s{verdict}"


def _first_line(text: object) -> str:
    return str(text).partition("\n")[0]


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m scenefold.simulation", description="A cluster in virtual time, from seeds.")
    parser.add_argument("--nodes", type=_between(NODES_MIN, NODES_MAX), default=5, metavar="N", help="founders (default 5)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seeds", type=_seeds, default=range(20), metavar="A:B", help="from A to B, B excluded (default 0:20)")
    which.add_argument("--replay", type=_seed, metavar="SEED", help="run one seed again")
    parser.add_argument("--workload", choices=WORKLOADS, default="all", help="data: no joins and drains; members: mostly those")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--jobs", type=_between(1, 256), default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--mutant", choices=sorted(MUTANTS), metavar="NAME", help=f"break the product first: {', '.join(sorted(MUTANTS))}")
    parser.add_argument("--seconds", type=_seconds, default=STORM_S, metavar="V", help=f"virtual seconds of storm (default {STORM_S:g})")
    parser.add_argument("--trace", metavar="FILE", help="write every event of a single seed to a file")
    parser.add_argument("--keep", type=_numbers, metavar="0,3,…", help="only these faults of the schedule, as a shortened story says")
    parser.add_argument("--no-shorten", dest="shorten", action="store_false", help="tell stories with all their faults")
    return parser


def _between(low: int, high: int):  # type: ignore[no-untyped-def]
    def number(text: str) -> int:
        value = int(text)
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{value} is not from {low} to {high}")
        return value

    return number


def _seed(text: str) -> int:
    value = int(text)
    if value < 0:
        raise argparse.ArgumentTypeError("a seed is not negative")
    return value


def _seeds(text: str) -> range:
    first, colon, end = text.partition(":")
    try:
        seeds = range(_seed(first), _seed(end)) if colon else range(_seed(first), _seed(first) + 1)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no range of seeds such as 0:200") from None
    if not seeds:
        raise argparse.ArgumentTypeError(f"{text!r} holds no seed: the end is excluded")
    return seeds


def _numbers(text: str) -> tuple[int, ...]:
    return () if text == "none" else tuple(_seed(part) for part in text.split(","))


def _seconds(text: str) -> float:
    value = float(text)
    if not value >= SECONDS_MIN:
        raise argparse.ArgumentTypeError(f"a storm lasts {SECONDS_MIN:g} seconds or more")
    return value


if __name__ == "__main__":
    raise SystemExit(main())
