"""If this fails, a node says that it holds a stray durably for a place that has become another's while it worked on the others."""

from __future__ import annotations

from typing import Any

from scenefold.base.reasons import RejectReason
from scenefold.peer.line.copying import hand_item
from scenefold.simulation import laws
from scenefold.store import Entry, Rightful
from scenefold.wire import HandItem, HandRecords, PutManyReply
from simulation.quiet import Rest, at_rest


async def items_of(rest: Rest) -> tuple[HandItem, ...]:
    """The two records of n1, as strays that n2 brings home."""
    context = rest.cluster.nodes[1].context
    assert context is not None and context.line.arc is not None
    manifest = await context.store.strays(Rightful([]), None, 32)
    entries: list[Entry] = [entry for entry in manifest.entries if entry.place.location in rest.places]
    found: list[Any] = list(await context.store.read([entry.spot for entry in entries]))
    return tuple(hand_item(entry, record) for entry, record in zip(entries, found, strict=True))


def answers(*, loses_lease: bool, checked: bool = True) -> tuple[list[int], list[str]]:
    """The reasons that n1 gives for two strays, if its lease ends while it takes the second; and the laws broken."""
    reasons: list[int] = []
    broken: list[str] = []

    async def look(rest: Rest) -> None:
        node = rest.cluster.nodes[1]
        assert node.context is not None
        taker: Any = node.context.line._strays._taking_home
        lease: Any = node.context.lease
        take = taker._take

        async def taking(items: Any, puts: Any) -> Any:
            problems = await take(items, puts)
            assert problems == [None, None], "both are here, durably"
            if loses_lease:
                lease.holds = lambda: False
            return problems

        taker._take = taking
        if not checked:
            taker._still_so = lambda _item, outcome: outcome
        items = await items_of(rest)
        assert len(items) == 2
        reply = await strays_handler(rest)(HandRecords(items), f"node:{rest.cluster.nodes[2].node_id}")
        assert isinstance(reply, PutManyReply)
        reasons.extend(outcome.reason for outcome in reply.outcomes)
        broken.extend(violation.law for violation in rest.cluster.watch.violations)

    at_rest(look)
    return reasons, broken


def strays_handler(rest: Rest) -> Any:
    """As a packet would reach it, looked on by the observer."""
    context: Any = rest.cluster.nodes[1].context
    return context.handlers._table[HandRecords][0]


def test_strays_are_acknowledged_under_a_lease() -> None:
    assert answers(loses_lease=False) == ([0, 0], [])


def test_what_was_taken_before_the_lease_ended_is_not_acknowledged_after() -> None:
    assert answers(loses_lease=True) == ([int(RejectReason.BUSY)] * 2, [])


def test_the_observer_sees_a_stray_acknowledged_without_a_lease() -> None:
    reasons, broken = answers(loses_lease=True, checked=False)
    assert reasons == [0, 0]
    assert broken == [laws.RIGHT_TO_ANSWER] * 2
