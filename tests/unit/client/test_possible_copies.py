"""If this fails, nobody who makes a space hears that it cannot have its copies, or hears so of one that can."""

from __future__ import annotations

from scenefold.base.ids import NodeId, node_id_of
from scenefold.base.location import LINE_LENGTH, Location
from scenefold.base.prefixes import address_prefix
from scenefold.client.possible_copies import shortages_to_come
from scenefold.client.shortages import Shortage
from scenefold.client.table import Owner

ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4", "127.0.0.5")


def owners(count: int, *, idle: int = 0, blacklists: dict[str, str] | None = None) -> list[Owner]:
    """So many nodes, the last of which own nothing."""
    found = []
    for index, address in enumerate(ADDRESSES[:count]):
        bound = Location.from_number(LINE_LENGTH * (index + 1) // count - 1) if index < count - idle else None
        listed = tuple(map(address_prefix, (blacklists or {}).get(address, "").split()))
        found.append(Owner(NodeId(node_id_of(address)), address, bound, blacklist=listed))
    return found


def told(shortages: list[Shortage]) -> list[tuple[str, int, bool]]:
    return [(short.address, short.possible, short.forbids_writes) for short in shortages]


def test_as_many_copies_as_there_are_nodes_are_no_shortage() -> None:
    assert shortages_to_come(owners(3), 3, 2) == [] == shortages_to_come(owners(1), 1, 1)


def test_too_few_nodes_are_told_once_and_refuse_no_write() -> None:
    (short,) = shortages_to_come(owners(3), 5, 4)
    assert told([short]) == [("", 3, False)], "a write is asked for as many as there are nodes"
    assert short.text == "in spaces with 5 copies only 3 of them can be there: the cluster has 3 nodes"
    assert short.to_do.startswith("add 2 nodes, and the copies are made")


def test_a_blacklist_that_leaves_too_few_is_named_with_its_entries() -> None:
    (short,) = shortages_to_come(owners(3, blacklists={"127.0.0.3": "127.0.0.4 10.0.0.0/8"}), 3, 2)
    assert told([short]) == [("127.0.0.3", 2, False)]
    assert "127.0.0.4 on its blacklist forbids 127.0.0.4" in short.text and "10.0.0.0/8" not in short.text + short.to_do
    assert "scenectl node blacklist rm 127.0.0.4 --node 127.0.0.3; or add a node" in short.to_do
    found = shortages_to_come(owners(3, blacklists={"127.0.0.2": "0.0.0.0/0", "127.0.0.3": "127.0.0.0/8"}), 3, 2)
    assert told(found) == [("127.0.0.2", 1, True), ("127.0.0.3", 1, True)]
    assert "writes are refused in spaces that need more than 1" in found[0].text


def test_a_blacklist_that_leaves_enough_is_none() -> None:
    assert shortages_to_come(owners(4, blacklists={"127.0.0.3": "127.0.0.4"}), 3, 2) == []


def test_few_nodes_and_a_blacklist_are_both_told() -> None:
    found = shortages_to_come(owners(3, blacklists={"127.0.0.2": "127.0.0.3"}), 4, 2)
    assert told(found) == [("", 3, False), ("127.0.0.2", 2, False)]


def test_nodes_without_an_arc_hold_copies_only_as_far_as_writes_need_them() -> None:
    (short,) = shortages_to_come(owners(4, idle=2), 4, 3)
    assert told([short]) == [("", 3, False)]
    assert "; 127.0.0.4, 127.0.0.5 own none" in short.text
    assert shortages_to_come(owners(3, idle=3), 3, 2) == [], "of a cluster that begins all are taken to own something"
