"""If this fails, nobody can tell why a node is not on the line any more, or one that came back is told of as gone."""

from __future__ import annotations

from scenefold.base.ids import address_of
from scenefold.client.removals import removed_nodes, still_gone
from scenefold.peer.cluster_log.registry import Registry
from scenefold.world.log_view import LogView
from unit.peer.logs_made import LOG_KEY, add, found, incarnation, node, record, remove, signed


def view() -> LogView:
    registry, known = Registry(), LogView()
    for entry in (
        found(4),
        add(0),
        add(1),
        add(2),
        remove(1, reason="silent"),
        remove(2, reason="drained"),
        add(1, left_of=0, life=1),
        remove(1, life=1, reason="again"),
        add(2, left_of=0, life=1),
    ):
        one = record(registry, entry)
        registry = registry.apply(one)
        known, _ = known.after([signed(one)], LOG_KEY.public)
    return known


def test_removals_are_told_newest_first_and_of_those_who_are_gone_the_last_one() -> None:
    removed = removed_nodes(view())
    first, second, voter = (address_of(node(number)) for number in (1, 2, 0))
    assert [(one.address, one.position, one.reason, one.is_back) for one in removed] == [
        (first, 8, "again", False),
        (second, 6, "drained", True),
        (first, 5, "silent", False),
    ]
    assert [(one.address, one.reason) for one in still_gone(removed)] == [(first, "again")]
    assert removed[0].document() == {
        "address": first,
        "incarnation": incarnation(1, 1).hex(),
        "position": 8,
        "reason": "again",
        "by": voter,
        "is_back": False,
    }
    assert removed_nodes(LogView()) == ()
