"""If this fails, a storm may leave something wrong and the simulation calls it quiet, or it calls a quiet cluster wrong."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import trio

from scenefold.base.location import Arc, Location
from scenefold.peer.line import Side
from scenefold.peer.line.holding import Holding, handover_id
from scenefold.peer.line.holding_note import encode_holding
from scenefold.simulation import laws
from scenefold.simulation.calm import unrest
from scenefold.simulation.cluster import Node
from scenefold.simulation.disks import arc_of, incarnation_of
from scenefold.store.layout import HOLDING, IDENTITY, RECORDS
from scenefold.wire import Member
from simulation.quiet import Rest, at_rest, overwrite


def exchange(node: Node, **parts: Any) -> None:
    """Give a running node's context other parts."""
    assert node.context is not None
    node.context = replace(node.context, **parts)


def arc_in(node: Node) -> Arc:
    arc = arc_of(node.disk)
    assert arc is not None
    return arc


def write_arc(rest: Rest, slot: int, arc: Arc) -> None:
    overwrite(rest.cluster.nodes[slot].disk, HOLDING, b"arc", arc.first + arc.last)


def no_voter(rest: Rest) -> None:
    rest.cluster.crash(0)


def dead_member(rest: Rest) -> None:
    rest.cluster.crash(1)


def not_yet_up(rest: Rest) -> None:
    rest.cluster.nodes[1].context = None


def newcomer(rest: Rest) -> None:
    rest.cluster.start(3)


def other_incarnation(rest: Rest) -> None:
    overwrite(rest.cluster.nodes[1].disk, IDENTITY, b"incarnation", bytes(16))


def old_log(rest: Rest) -> None:
    exchange(rest.cluster.nodes[1], cluster_log=SimpleNamespace(registry=SimpleNamespace(position=1)))


def no_lease(rest: Rest) -> None:
    exchange(rest.cluster.nodes[1], lease=SimpleNamespace(holds=lambda: False))


def gap(rest: Rest) -> None:
    arc = arc_in(rest.cluster.nodes[1])
    write_arc(rest, 1, Arc(arc.first, Location.from_number(arc.last.number - 1)))


def overlap(rest: Rest) -> None:
    arc = arc_in(rest.cluster.nodes[1])
    write_arc(rest, 1, Arc(Location.from_number(arc.first.number - 1), arc.last))


def open_handover(rest: Rest) -> None:
    node, neighbour = rest.cluster.nodes[1], rest.cluster.nodes[2]
    incarnation = incarnation_of(neighbour.disk)
    assert incarnation is not None
    arc = arc_in(node)
    piece = Arc(Location.from_number(arc.last.number - 9), arc.last)
    holding = Holding().found(arc)
    offered = holding.offer(handover_id(holding.revision + 1, bytes(8)), Side.RIGHT, Member(neighbour.node_id, incarnation), piece)
    overwrite(node.disk, HOLDING, b"note", encode_holding(offered))


def stray(rest: Rest) -> None:
    key = rest.key(2, 5)
    overwrite(rest.cluster.nodes[0].disk, RECORDS, key, rest.cluster.nodes[2].disk.peek(RECORDS)[key])


def stray_of_a_spare(rest: Rest) -> None:
    """It was a member, and has left what it held behind."""
    spare = rest.cluster.nodes[3]
    spare.disk.restore(rest.cluster.nodes[2].disk.snapshot())
    overwrite(spare.disk, HOLDING, b"arc", b"")
    spare.born.set()


def wrong_table(rest: Rest) -> None:
    node = rest.cluster.nodes[1]
    assert node.context is not None
    (first, one), (second, other), *rest_of_them = node.context.routing.owners
    exchange(node, routing=SimpleNamespace(owners=[(first, other), (second, one), *rest_of_them]))


WRONG: list[tuple[Callable[[Rest], None], str, str, tuple[int, ...]]] = [
    (no_voter, laws.CONVERGED, "the voter does not run", (0,)),
    (dead_member, laws.CONVERGED, "n1 is a member and does not run", (1,)),
    (not_yet_up, laws.CONVERGED, "n1 does not run", (1,)),
    (newcomer, laws.CONVERGED, "n3 does not run", (3,)),
    (newcomer, laws.CONVERGED, "n3 is no member", (3,)),
    (other_incarnation, laws.CONVERGED, "n1 runs under another incarnation than is registered", (1,)),
    (old_log, laws.CONVERGED, "n1 does not know the newest log", (1,)),
    (no_lease, laws.CONVERGED, "n1 holds no lease", (1,)),
    (gap, laws.TILED, "nobody owns", ()),
    (overlap, laws.TILED, "n1 owns", ()),
    (open_handover, laws.CONVERGED, "a handover of n1 is open", (1,)),
    (stray, laws.CONVERGED, "1 strays lie on n0, the first at", (0,)),
    (stray_of_a_spare, laws.CONVERGED, "strays lie on n3, the first at", (3,)),
    (wrong_table, laws.CONVERGED, "the table of n1 is not that of the disks", (1,)),
]


@pytest.mark.parametrize(("spoil", "law", "said", "slots"), WRONG, ids=[f"{spoil.__name__}: {said}" for spoil, _, said, _ in WRONG])
def test_what_is_wrong_is_said(spoil: Callable[[Rest], None], law: str, said: str, slots: tuple[int, ...]) -> None:
    async def look(rest: Rest) -> None:
        assert unrest(rest.cluster) == []
        spoil(rest)
        found = unrest(rest.cluster)
        assert [wrong.law for wrong in found] == [law] * len(found)
        assert [wrong.slots for wrong in found if said in wrong.what] == [slots], found

    at_rest(look)


def test_a_rotten_stray_is_left_in_peace_until_something_else_lies_there() -> None:
    async def look(rest: Rest) -> None:
        disk, key = rest.cluster.nodes[0].disk, rest.key(2, 5)
        sound = rest.cluster.nodes[2].disk.peek(RECORDS)[key]
        overwrite(disk, RECORDS, key, sound[:-1] + bytes([sound[-1] ^ 1]))
        rest.cluster.watch.damaged(0, key, {})
        assert unrest(rest.cluster) == []
        overwrite(disk, RECORDS, key, sound)
        assert [wrong.what[:20] for wrong in unrest(rest.cluster)] == ["1 strays lie on n0, "]

    at_rest(look)


def test_who_left_may_have_an_old_backup() -> None:
    async def look(rest: Rest) -> None:
        stray_of_a_spare(rest)
        spare, incarnation = rest.cluster.nodes[3], incarnation_of(rest.cluster.nodes[3].disk)
        assert incarnation is not None
        rest.cluster.watch.put_back[3] = incarnation
        assert unrest(rest.cluster) != [], "it may still be told to bring them home"
        spare.has_left = True
        assert unrest(rest.cluster) == []
        rest.cluster.watch.put_back[3] = bytes(16)
        assert unrest(rest.cluster) != [], "it has lived on under another incarnation since"

    at_rest(look)


def test_a_cluster_stays_quiet() -> None:
    async def look(rest: Rest) -> None:
        await trio.sleep(20.0)
        assert unrest(rest.cluster) == []
        assert rest.cluster.watch.violations == []

    at_rest(look)
