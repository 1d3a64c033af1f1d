"""`python -m scenefold.simulation`: run seeds, or one again (docs/how-to/simulate.md).

Progress and stories go to stderr. On stdout comes a summary, or with --json one object with the keys `seeds` (how many were
run), `violations` (a list), `faults` (how many took effect, by kind), `reported` (what lying nodes achieved that nobody could prevent, by manner), `operations` (acknowledged
ones), the least of both that a seed had, `short` (seeds that tested too little), and, with the workload `logs`, `committed`, `refused`, `taken_over`,
`committed_min`, `switches`, `edits`, `late` and `looks`; with `renders` the fields of `outcome.Renders` and `images_min`. It comes before any schedule is shortened, which takes minutes. The exit
code is 1 if anything was violated, 3 if nothing was but a seed fell short, 2 for wrong usage.
"""

from __future__ import annotations

import json
import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from scenefold.simulation.crowd import run_all, run_one
from scenefold.simulation.outcome import Result
from scenefold.simulation.shrink import shorten
from scenefold.simulation.usage import orders_of

HELD, VIOLATED, FELL_SHORT = 0, 1, 3
STORIES_MAX = 3
"""Stories that are shortened and told in full; of further violations one line each."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what the arguments say; the process's exit code."""
    orders, options = orders_of(arguments)
    results: list[Result] = []
    for result in run_all(orders, min(options.jobs, len(orders))):
        results.append(result)
        _say(f"{len(results)}/{len(orders)} {_line_of(result)}")
    results.sort(key=lambda result: result.order.seed)
    failed = [result for result in results if result.violations]
    _report(results, as_json=options.json)
    for result in failed[:STORIES_MAX]:
        try:
            _say("\n" + (_shortened(result) if options.shorten else result).story)
        except KeyboardInterrupt:
            _say(f"interrupted; with all its faults:\n\n{result.story}")
            break
    if failed:
        return VIOLATED
    return FELL_SHORT if any(result.shortage for result in results) else HELD


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
    faults, reported = Counter[str](), Counter[str]()
    for result in results:
        faults.update(result.faults)
        reported.update(result.reported)
        if result.shortage:
            _say(f"the harness falls short: seed {result.order.seed} had only {result.shortage}")
    operations = sum(result.operations for result in results)
    violations = [
        {"seed": result.order.seed, "law": found.law, "what": found.what, "at_s": round(found.at_s, 6), "replay": result.order.replay}
        for result in results
        for found in result.violations
    ]
    operations_min = min(result.operations for result in results)
    faults_min = min(sum(result.faults.values()) for result in results)
    if as_json:
        document = {
            "seeds": len(results),
            "violations": violations,
            "faults": dict(sorted(faults.items())),
            "reported": dict(sorted(reported.items())),
            "operations": operations,
            "operations_min": operations_min,
            "faults_min": faults_min,
            "short": [{"seed": result.order.seed, "what": result.shortage} for result in results if result.shortage],
            **_proposals(results),
            **_renders(results),
        }
        _print(json.dumps(document, indent=2))
        return
    lines = [f"{len(results)} seeds, {operations} acknowledged operations, {faults.total()} faults, {len(violations)} violations"]
    lines += [f"a seed had {operations_min} operations and {faults_min} faults or more"]
    if told := _proposals(results):
        lines.append(
            f"{told['committed']} proposals committed, {told['committed_min']} of a seed or more, {told['refused']} refused, {told['taken_over']} taken over"
        )
        lines.append(
            f"{told['switches']} changes of mode, {told['edits']} edits stored, {told['late']} too late, {told['looks']} records read for images"
        )
    if renders := _renders(results):
        lines.append(", ".join(f"{count} {name.replace('_', ' ')}" for name, count in renders.items()))
    lines += [f"  {count:7d}  {kind}" for kind, count in sorted(faults.items())]
    lines += [f"  reported, no violation: {count} {manner}" for manner, count in sorted(reported.items())]
    lines += [f"seed {one['seed']}: {one['law']}: {_first_line(one['what'])}\n  {one['replay']}" for one in violations]
    _print("\n".join(lines))


def _proposals(results: Sequence[Result]) -> dict[str, int]:
    """What became of proposals; empty if the workload has none."""
    found = [result.proposals for result in results if result.proposals is not None]
    if not found:
        return {}
    return {
        "committed": sum(each.committed for each in found),
        "refused": sum(each.refused for each in found),
        "taken_over": sum(each.taken_over for each in found),
        "committed_min": min(each.committed for each in found),
        "switches": sum(each.switches for each in found),
        "edits": sum(each.edits for each in found),
        "late": sum(each.late for each in found),
        "looks": sum(each.looks for each in found),
    }


def _renders(results: Sequence[Result]) -> dict[str, int]:
    """What came of renders; empty if the workload has none."""
    found = [result.renders._asdict() for result in results if result.renders is not None]
    if not found:
        return {}
    return {**{name: sum(each[name] for each in found) for name in found[0]}, "images_min": min(each["images"] for each in found)}


def _print(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()


def _line_of(result: Result) -> str:
    what = f"seed {result.order.seed}: {result.operations} operations, {sum(result.faults.values())} faults"
    counts = ", ".join(f"{count} {name}" for name, count in sorted(result.counts.items()))
    if result.renders is not None:
        counts = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in result.renders._asdict().items())
    if result.proposals is not None:
        told = result.proposals
        modes = f"{told.switches} switches, {told.edits} edits, {told.late} late, {told.looks} looks"
        counts = f"{result.order.deciders} participants, {told.committed} committed, {told.refused} refused, {told.taken_over} taken over, {modes}, {counts}"
    verdict = f" VIOLATED {result.violations[0].law}: {_first_line(result.violations[0].what)}" if result.violations else ""
    return f"{what}, {counts}, {result.virtual_s:.0f} s in {result.cpu_s:.2f} s{verdict}"


def _first_line(text: object) -> str:
    return str(text).partition("\n")[0]


def _say(text: str) -> None:
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


if __name__ == "__main__":
    raise SystemExit(main())
