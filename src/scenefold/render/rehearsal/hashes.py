"""The contract of hashes: one image, whatever nodes, cells, lost packets and deaths (specs/08-passes.md, 30-ray-links.md, 31-attempts.md). All in one process.

A row is a render. It says the image's hash, and that the render was one of several nodes: how many rays went from node to node for each path,
and how much of all triangles the node with most of them held.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any

from scenefold.base.ids import NodeId, node_id_of
from scenefold.render.image_files import image_sha256
from scenefold.render.job import RenderOptions
from scenefold.render.layers import unpacked
from scenefold.render.pool.mover import Pace
from scenefold.render.pool.request import organiser_of
from scenefold.render.rehearsal.faults import Faults, FaultyPool
from scenefold.render.rehearsal.pool import Records, running
from scenefold.wire import Packet, SendRays
from scenefold.world import World

PASSED_MIN = 0.3
"""Rays passed for each path, where two nodes at least are left: else they were not needed."""
SHARE_MAX = 0.7
"""Of all triangles at one node, from SHARED_FROM nodes on."""
SHARED_FROM = 5
JOB = 11
FAULTY_SHARE = 0.05
EAGER = Pace(look_s=0.01, rest=0.0, worth=0.0)
"""Cells move after each round, whether that is worth while or not."""


class Mishap(Enum):
    """What goes wrong in a render; the value is the name in reports."""

    NONE = "none"
    LOST = "5 % lost"
    DOUBLED = "5 % doubled"
    KILLED = "one killed"


_FAULTS = {Mishap.LOST: Faults(lost=FAULTY_SHARE), Mishap.DOUBLED: Faults(doubled=FAULTY_SHARE)}


@dataclass(frozen=True, slots=True)
class Row:
    """One render. `share`: None if nothing is there to share; `broken`: what of the contract does not hold, "" if all does."""

    nodes: int
    algorithm: str
    moving: bool
    mishap: Mishap
    sha256: str
    passed_per_path: float
    share: float | None
    moved: int
    lost: int
    broken: str = ""

    def document(self) -> dict[str, Any]:
        """The JSON form (docs/reference/scenectl.md)."""
        return {
            "nodes": self.nodes,
            "algorithm": self.algorithm,
            "cells": "moving" if self.moving else "fixed",
            "mishap": self.mishap.value,
            "image_sha256": self.sha256,
            "rays_passed_per_path": round(self.passed_per_path, 3),
            "largest_share": None if self.share is None else round(self.share, 3),
            "cells_moved": self.moved,
            "nodes_lost": self.lost,
            "broken": self.broken,
        }


class Contract:
    """Of one scene. The first row is that of one node; all others must have its hash."""

    def __init__(self, world: World, records: Records, options: RenderOptions) -> None:
        self._world, self._records, self._options = world, records, options
        self._expected = ""
        self._rays: dict[tuple[int, str, bool], int] = {}
        """Packets of rays in the render without mishap."""

    async def rows(self, counts: Sequence[int], algorithms: Sequence[str], mishaps: Sequence[Mishap]) -> AsyncIterator[Row]:
        """One node at first, then so many nodes in each algorithm, with fixed and moving cells, and each of these mishaps."""
        options = replace(self._options, algorithm=algorithms[0], moving=False)
        alone = await self._row(1, options, Mishap.NONE)
        self._expected = alone.sha256
        yield alone
        other = await self._row(1, replace(options, seed=options.seed + 1), Mishap.NONE)
        if other.sha256 == alone.sha256:
            yield replace(other, broken="another seed has the same hash")
        for count in counts:
            for algorithm in algorithms if count > 1 else ():
                for moving in (False, True):
                    for mishap in sorted({Mishap.NONE, *mishaps}, key=list(Mishap).index):
                        yield await self._row(count, replace(options, algorithm=algorithm, moving=moving), mishap)

    async def _row(self, count: int, options: RenderOptions, mishap: Mishap) -> Row:
        key = count, options.algorithm, options.moving
        async with running(FaultyPool(self._world, self._records, count, _FAULTS.get(mishap, Faults()))) as pool:
            pool.pace = EAGER
            if mishap is Mishap.KILLED:
                _kill_at(pool, self._rays.get(key, 0) // 2)
            image, state = await pool.render(JOB, options)
        if mishap is Mishap.NONE:
            self._rays[key] = pool.carried[SendRays.__name__]
        told = state["nodes"]
        triangles = [node["triangles"] for node in told if "triangles" in node]
        row = Row(
            nodes=count,
            algorithm=options.algorithm,
            moving=options.moving,
            mishap=mishap,
            sha256=hash_of(image, options),
            passed_per_path=sum(node["rays_sent"] for node in told if "rays_sent" in node) / options.plan.paths,
            share=max(triangles) / sum(triangles) if sum(triangles) else None,
            moved=state["moved"],
            lost=len(state["lost"]),
        )
        return replace(row, broken=self._broken(row, pool))

    def _broken(self, row: Row, pool: FaultyPool) -> str:
        """The first thing that is not as it must be."""
        if self._expected and row.sha256 != self._expected and row.nodes > 1:
            return "another image"
        if row.nodes - row.lost > 1 and row.passed_per_path <= PASSED_MIN:
            return f"fewer than {PASSED_MIN} rays passed for each path"
        if row.nodes >= SHARED_FROM and row.share is not None and row.share >= SHARE_MAX:
            return f"one node has {SHARE_MAX} of all triangles or more"
        if row.mishap is Mishap.KILLED and not row.lost:
            return "nobody was lost"
        if row.mishap is Mishap.LOST and not pool.dropped:
            return "nothing was lost"
        return ""


def hash_of(image: bytes, options: RenderOptions) -> str:
    """The one that a render of an image tells."""
    return image_sha256(unpacked(image, options.layers, options.window.width, options.window.height)["beauty"])


def _kill_at(pool: FaultyPool, packets: int) -> None:
    """Kill a node once so many packets of rays were sent: the one in the middle of those that do not organise the job."""
    others = [node for node in pool.nodes if node != organiser_of(JOB, pool.nodes)]
    victim: NodeId = others[len(others) // 2] if others else node_id_of("127.0.0.2")
    sent = 0

    def count(packet: Packet) -> None:
        nonlocal sent
        sent += isinstance(packet, SendRays)
        if sent == max(packets, 1) and others:
            pool.kill(victim)

    pool.on_carry = count
