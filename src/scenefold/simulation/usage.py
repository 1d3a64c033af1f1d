"""What `python -m scenefold.simulation` may be told: one clear line, and exit code 2, for everything else."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NoReturn, TypeVar

from scenefold.base.limits import DECIDERS_MAX, VOTERS_MAX
from scenefold.simulation.faults import KINDS, Kind
from scenefold.simulation.mutants import MUTANTS
from scenefold.simulation.outcome import OF_CLIENTS, SPARED, WORKLOADS, Order
from scenefold.simulation.weather import STORM_S

N = TypeVar("N", int, float)

WRONG_USAGE = 2
NODES_MIN, NODES_MAX = 3, 64
NODES = 5
JOBS_MAX = 256
SECONDS_MIN, SECONDS_MAX = 20.0, 600.0
SEED_MAX = (1 << 63) - 1
SEEDS_MAX = 1_000_000


class Parser(argparse.ArgumentParser):
    """Says what is wrong without repeating all the options."""

    def error(self, message: str) -> NoReturn:
        self.exit(WRONG_USAGE, f"{self.prog}: {message}\n")


def orders_of(arguments: Sequence[str] | None) -> tuple[list[Order], argparse.Namespace]:
    """The runs that are asked for, and everything else. Wrong usage ends the process."""
    parser = _parser()
    options = parser.parse_args(arguments)
    seeds = range(options.replay, options.replay + 1) if options.replay is not None else options.seeds
    if options.keep is not None and options.replay is None:
        parser.error("--keep is for one seed: give --replay")
    if options.trace is not None:
        if len(seeds) > 1:
            parser.error("--trace is for one seed: give --replay")
        _check_writable(parser, options.trace)
    if options.faults and options.workload == "data" and all(KINDS[kind].moves_members for kind in options.faults):
        parser.error("--workload data leaves all of these --faults out")
    if options.voters > (options.nodes or NODES):
        parser.error(f"--voters {options.voters} are more than the {options.nodes or NODES} --nodes")
    if options.participants is not None and options.workload != "logs":
        parser.error("--participants is for --workload logs")
    if options.workload not in OF_CLIENTS and (others := [kind.value for kind in options.faults if KINDS[kind].of_clients]):
        parser.error(f"--faults: {', '.join(others)}: only with --workload {' or '.join(OF_CLIENTS)}")
    if options.workload != "renders" and (others := [kind.value for kind in options.faults if KINDS[kind].of_renders]):
        parser.error(f"--faults: {', '.join(others)}: only with --workload renders")
    if options.workload == "renders" and options.faults and all(kind in SPARED for kind in options.faults):
        parser.error("--workload renders leaves all of these --faults out")
    if not options.copies and (lonely := [kind.value for kind in options.faults if KINDS[kind].of_copies]):
        parser.error(f"--faults: {', '.join(lonely)}: only with --copies")
    orders = [_order(parser, options, seed) for seed in seeds]
    if options.keep is not None and max(options.keep, default=-1) >= (known := len(replace(orders[0], keep=None).schedule)):
        parser.error(f"--keep names a fault that this seed does not have: it has {known}, from 0")
    return orders, options


def _order(parser: Parser, options: argparse.Namespace, seed: int) -> Order:
    """What is asked of one seed."""
    asked = (
        options.workload,
        options.mutant,
        options.seconds,
        options.faults,
        options.keep,
        options.trace,
        options.copies,
        options.participants,
        options.voters,
    )
    order = Order(seed, options.nodes or NODES, *asked)
    if options.workload != "logs":
        return order
    if options.nodes is None:
        # One more than decide at least: it may observe.
        return replace(order, nodes=max(NODES, order.deciders + 1))
    if order.deciders > order.nodes:
        parser.error(f"--nodes {options.nodes} are fewer than the {order.deciders} participants of seed {seed}")
    return order


def _check_writable(parser: Parser, path: str) -> None:
    try:
        Path(path).open("w").close()
    except OSError as problem:
        parser.error(f"argument --trace: {problem}")


def _parser() -> Parser:
    parser = Parser(prog="python -m scenefold.simulation", description="A cluster in virtual time, from seeds.")
    nodes, seconds = number(int, NODES_MIN, NODES_MAX), number(float, SECONDS_MIN, SECONDS_MAX)
    parser.add_argument("--nodes", type=nodes, metavar="N", help=f"founders (default {NODES}, and one more than decide the log at least)")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--seeds", type=_seeds, default=range(20), metavar="A:B", help="from A to B, B excluded (default 0:20)")
    which.add_argument("--replay", type=number(int, 0, SEED_MAX), metavar="SEED", help="run one seed again")
    parser.add_argument(
        "--workload",
        choices=WORKLOADS,
        default="all",
        help="data: no joins and drains; members: mostly those and crashes, and slow clients; all: joins and drains as well (default); keys: like all, and the scene's key changes; purges: like all, and deletions are purged; turns: like all, and spaces come to have other numbers of copies, with --copies; logs: clients change the scene's log, which participants decide, edit and render; renders: clients have a scene rendered, with cells that move, by nodes that die",
    )
    parser.add_argument(
        "--participants",
        type=number(int, 0, DECIDERS_MAX),
        metavar="N",
        help="with --workload logs: who decides the log; 0: its origin alone (default: 3, 5 or 7, by the seed)",
    )
    parser.add_argument(
        "--voters", type=number(int, 1, VOTERS_MAX), default=1, metavar="N", help="who decides the cluster's log (default 1, by its key)"
    )
    parser.add_argument("--copies", action="store_true", help="some spaces have copies, and nodes and racks are lost for ever")
    parser.add_argument("--json", action="store_true", help="one JSON object on stdout")
    parser.add_argument("--jobs", type=number(int, 1, JOBS_MAX), default=2, metavar="N", help="processes (default 2)")
    parser.add_argument("--mutant", choices=sorted(MUTANTS), metavar="NAME", help=f"break the product first: {', '.join(sorted(MUTANTS))}")
    parser.add_argument("--seconds", type=seconds, default=STORM_S, metavar="V", help=f"virtual seconds of storm (default {STORM_S:g})")
    parser.add_argument("--faults", type=_kinds, default=(), metavar="KIND,…", help="these kinds of faults, and no others")
    parser.add_argument("--trace", metavar="FILE", help="write every event of a single seed to a file")
    parser.add_argument("--keep", type=_keep, metavar="0,3,…", help="only these faults of the schedule, as a shortened story says")
    parser.add_argument("--no-shorten", dest="shorten", action="store_false", help="tell stories with all their faults")
    return parser


def number(kind: Callable[[str], N], low: N, high: N) -> Callable[[str], N]:
    """Reads a number of a kind within bounds."""

    def read(text: str) -> N:
        try:
            value = kind(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f"{text!r} is no number from {low:g} to {high:g}") from None
        if not low <= value <= high:
            raise argparse.ArgumentTypeError(f"{text} is not from {low:g} to {high:g}")
        return value

    return read


def _seeds(text: str) -> range:
    seed = number(int, 0, SEED_MAX)
    first, colon, end = text.partition(":")
    try:
        seeds = range(seed(first), seed(end) if colon else seed(first) + 1)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{text!r} is no range of seeds such as 0:200") from None
    if not seeds:
        raise argparse.ArgumentTypeError(f"{text!r} holds no seed: the end is excluded, and lies behind the beginning")
    if seeds.stop - seeds.start > SEEDS_MAX:
        raise argparse.ArgumentTypeError(f"{text!r} holds more than {SEEDS_MAX} seeds")
    return seeds


def _kinds(text: str) -> tuple[Kind, ...]:
    try:
        return tuple(dict.fromkeys(map(Kind, text.split(","))))
    except ValueError:
        known = ", ".join(kind.value for kind in Kind)
        raise argparse.ArgumentTypeError(f"{text!r} is no list of kinds of faults; there are: {known}") from None


def _keep(text: str) -> tuple[int, ...]:
    try:
        return () if text == "none" else tuple(sorted({number(int, 0, SEED_MAX)(part) for part in text.split(",")}))
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of faults such as 0,3,7, nor none") from None
