"""What a job's organiser says of it, as a client takes it: each value is what it should be, or PeerFault. Pure.

The organiser is a node that the client trusts with the scene, and not with its own process, terminal and memory.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

from scenefold.base.errors import PeerFault
from scenefold.base.ids import checked_node_id
from scenefold.base.limits import POOL_NODES_MAX
from scenefold.base.plain_values import exactly, number, text, whole
from scenefold.base.rays import RAY_BYTES
from scenefold.render.job import HASH_BYTES, RenderOptions
from scenefold.render.layers import image_bytes
from scenefold.wire import MalformedPacket, unpack_value

PHASES = frozenset({"preparing", "rendering", "merging", "done", "failed"})
PREVIEWS_MAX = 2**32 - 2
_COUNT_MAX = 2**64 - 1
_COUNTS = (
    "records",
    "groups",
    "triangles",
    "bytes_read",
    "closed",
    "owned",
    "rays",
    "casts",
    "shadow_casts",
    "rays_sent",
    "packets_sent",
    "packets_resent",
    "acknowledgements_sent",
    "rays_received",
    "not_finite",
    "clamped",
    "late",
)
_SECONDS = ("prepare_seconds", "busy_seconds")
_ROUNDS_MAX = 256
_CHARACTERS_MAX = 200
_STEPS_MAX = 16


@dataclass(frozen=True, slots=True)
class Stand:
    """How a job stands."""

    phase: str
    closed: int
    passes: int
    kept: int
    """The newest film that can be fetched is of all passes below this one; 0: there is none."""
    content: bytes
    """Of the scene, once it is known; else zeros."""
    failure_reason: int
    failure: str
    lost: tuple[str, ...]
    """Addresses of nodes that died meanwhile, as the organiser says;"""
    back: tuple[str, ...]
    """and of those that took part again later."""
    preview: int
    """Number of the newest preview; 0 for none."""
    document: dict[str, Any]
    """All of it, unread."""

    @property
    def pools(self) -> int:
        """In how many render pools the nodes stand, each of which holds the whole scene, as the organiser says; 1 before it does."""
        pools = self.document.get("pools")
        return pools if isinstance(pools, int) and 1 <= pools <= POOL_NODES_MAX else 1


def stand_of(packed: bytes, where: str) -> Stand:
    """A state as it came."""
    with believed(where):
        document = unpack_value(packed, what="a job's state")
        if not isinstance(document, dict) or document["phase"] not in PHASES:
            raise ValueError("a phase is expected")
        passes = whole(document["passes"], 0, _COUNT_MAX)
        reason, failure = whole(document["failure_reason"], 0, 255), text(document["failure"])
        closed, kept = whole(document["closed"], 0, passes), whole(document["kept_passes"], 0, passes)
        lost, back = (tuple(map(_short, _few(document[name], POOL_NODES_MAX))) for name in ("lost", "back"))
        content = exactly(document["content"], HASH_BYTES)
        preview = whole(document.get("preview", 0), 0, PREVIEWS_MAX)
        return Stand(document["phase"], closed, passes, kept, content, reason, failure, lost, back, preview, document)


@dataclass(frozen=True, slots=True)
class NodeStand:
    """How one node of a job stands; all counts are of the job so far, and 0 before it traces."""

    address: str
    triangles: int
    """In its cell."""
    casts: int
    rays_sent: int
    waiting: int
    """Rays that are to be traced here."""
    busy_s: float
    """That its threads spent tracing, added up."""
    memory: int = 0
    """Bytes, the most that its process has taken; 0 if it does not say."""


def nodes_of(stand: Stand, where: str) -> list[NodeStand]:
    """What the organiser says of the job's nodes while it goes on. PeerFault if that is ill-formed."""
    with believed(where):
        return [_node_stand(row) for row in _few(stand.document["nodes"], POOL_NODES_MAX)]


def _node_stand(row: dict[str, Any]) -> NodeStand:
    names = ("triangles", "casts", "rays_sent", "waiting", "memory_most")
    triangles, casts, sent, waiting, memory = (whole(row.get(name, 0), 0, _COUNT_MAX) for name in names)
    return NodeStand(_one_of(row["address"], None), triangles, casts, sent, waiting, _seconds(row.get("busy_seconds", 0.0)), memory)


def image_size(options: RenderOptions) -> int:
    """The bytes of a finished image."""
    return image_bytes(options.layers, options.window.pixels)


def numeric_class_of(stand: Stand, where: str) -> str:
    """What the organiser says of it; PeerFault if that is none."""
    with believed(where):
        return _short(stand.document["numeric_class"])


def class_told(packed: bytes, where: str) -> str:
    """The numeric class in which a node renders, as it tells whoever asks of all jobs; empty if it says none. PeerFault if that is none."""
    with believed(where):
        document = unpack_value(packed, what="what a node tells of its jobs")
        if not isinstance(document, dict):
            raise ValueError("a document is expected")
        return _short(document.get("numeric_class", ""))


def report_of(state: dict[str, Any], options: RenderOptions, chosen: Collection[str] | None, where: str) -> dict[str, Any]:
    """The report of a finished image (docs/reference/scenectl.md). `chosen`: addresses of those that may have rendered it; None if another client chose."""
    with believed(where):
        plan, least = options.plan, options.plan
        if options.adaptive is not None:
            least = replace(options, samples=options.adaptive.levels(options.samples)[0]).plan
        size = image_size(options)
        whole(state["image_bytes"], size, size)
        paths, passes = whole(state["paths"], least.paths, plan.paths), whole(state["passes"], least.count, plan.count)
        before, moved = whole(state["paths_before"], 0, paths), whole(state["moved"], 0, _COUNT_MAX)
        pools = whole(state.get("pools", 1), 1, POOL_NODES_MAX)
        attempts, again = whole(state["attempts"], 1, _COUNT_MAX), whole(state["passes_again"], 0, _COUNT_MAX)
        lost, back = ([_one_of(address, chosen) for address in _few(state[name], POOL_NODES_MAX)] for name in ("lost", "back"))
        seconds = {_short(name): _seconds(value) for name, value in _few(state["seconds"].items(), _STEPS_MAX)}
        nodes = [_node(row, chosen) for row in _few(state["nodes"], POOL_NODES_MAX)]
        if not nodes:
            raise ValueError("an image that no node has made")
        numeric_class = _short(state["numeric_class"])
        rounds = [_round(row) for row in _few(state.get("rounds", []), _ROUNDS_MAX)]
        tail = [_seconds(value) for value in _few(state.get("tail", []), 2)]
        if len(tail) == 1:
            raise ValueError("a tail is two times, or none")
    casts = [node["casts"] for node in nodes]
    passed, rays = (sum(node[name] for node in nodes) for name in ("rays_sent", "rays"))
    rendering = max(seconds.get("render", 0.0), 1e-9)
    return {
        "partition": "spatial",
        "passes": passes,
        "paths": paths,
        "samples_per_pixel": paths / options.window.pixels,
        "numeric_class": numeric_class,
        "paths_before": before,
        "paths_per_second": (paths - before) / rendering,
        "rays": rays,
        "rays_per_second": rays / rendering,
        "cell_visits": sum(casts),
        "cells_moved": moved,
        "pools": pools,
        "attempts": attempts,
        "nodes_lost": lost,
        "nodes_back": back,
        "passes_traced_again": again,
        "rays_passed": passed,
        "rays_passed_per_path": passed / max(paths - before, 1),
        "packets_passed": sum(node["packets_sent"] for node in nodes),
        "bytes_passed": passed * RAY_BYTES,
        "efficiency": sum(casts) / (len(casts) * max(casts)) if max(casts) else 1.0,
        "rounds": [{"cell_visits": visits, "efficiency": visits / (count * most)} for visits, most, count in rounds],
        "efficiency_of_rounds": efficiency_of(rounds),
        "tail": None if not tail else {"seconds_to_95": round(tail[0], 3), "seconds_to_100": round(tail[1], 3)},
        "contributions_not_finite": sum(node["not_finite"] for node in nodes),
        "contributions_clamped": sum(node["clamped"] for node in nodes),
        "render_seconds": {name: round(value, 3) for name, value in seconds.items()},
        "render_nodes": nodes,
    }


def efficiency_of(rounds: Sequence[tuple[int, int, int]]) -> float:
    """Of all rounds: the work that was done over what would have been, had all been as busy as the busiest in each; 1 without any.

    A round: visits of cells by all nodes, by the busiest one, and how many nodes there were.
    """
    might = sum(most * count for _, most, count in rounds)
    return sum(visits for visits, _, _ in rounds) / might if might else 1.0


def _round(row: Any) -> tuple[int, int, int]:
    visits, most, count = (whole(value, 1, _COUNT_MAX) for value in row)
    return whole(visits, most, most * count), most, whole(count, 1, POOL_NODES_MAX)


def _node(row: dict[str, Any], chosen: Collection[str] | None) -> dict[str, Any]:
    """What is told of a node, in the order in which it is reported."""
    _one_of(row["address"], chosen)
    counts = {name: whole(row[name], 0, _COUNT_MAX) for name in _COUNTS}
    # Of an earlier version nothing is known of these.
    used = {
        "processor_seconds": _seconds(row.get("processor_seconds", 0.0)),
        "memory_most": whole(row.get("memory_most", 0), 0, _COUNT_MAX),
    }
    return {"address": row["address"], **counts, **{name: _seconds(row[name]) for name in _SECONDS}, **used}


def _one_of(address: object, chosen: Collection[str] | None) -> str:
    known = text(address)
    if chosen is None:
        checked_node_id(known)
    elif known not in chosen:
        raise ValueError("a node that was not chosen")
    return known


def _few(values: Any, most: int) -> list[Any]:
    known = list(values)
    if len(known) > most:
        raise ValueError(f"at most {most} are expected")
    return known


def _seconds(value: object) -> float:
    seconds = number(value)
    if seconds < 0:
        raise ValueError("a time is expected")
    return seconds


def _short(value: object) -> str:
    words = text(value)
    if len(words) > _CHARACTERS_MAX or not words.isprintable():
        raise ValueError("a short text is expected")
    return words


@contextmanager
def believed(where: str) -> Iterator[None]:
    """Around the reading of what an organiser says: PeerFault if it is ill-formed."""
    try:
        yield
    except (MalformedPacket, KeyError, TypeError, ValueError, AttributeError) as error:
        raise PeerFault(f"what the organiser says of the job is ill-formed ({type(error).__name__}: {error})", where=where) from error
