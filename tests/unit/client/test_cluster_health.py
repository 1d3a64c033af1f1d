"""If one fails, `cluster health` calls a cluster healthy that is not, or sends people to mend what mends itself."""

from __future__ import annotations

import copy
import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from scenefold.base.errors import PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client import Cluster
from scenefold.client.cluster_health import ClusterHealth, Condition, health_of
from scenefold.client.health import NEVER_CAME, NodeState
from scenefold.wire import AcknowledgeLosses, LossesKept, encode_packet
from scenefold.wire.loss_packets import LOSSES_KEPT_MAX
from scenefold.world import Priority
from unit.client.test_health import ADDRESSES, arc, missing, node, report, status_of

SOUND: dict[str, Any] = {
    "owned": {"records": 120, "records_with_copies": 100},
    "segments": 3,
    "under_copied": {"segments": 0, "missing_max": 0, "records": 0},
    "owed": {"records": 0, "records_to_silent": 0, "nodes": []},
    "mis_placed": {"segments": 0, "records": 0},
    "forbidden": {"segments": 0, "records": 0, "nodes": []},
    "comparing": {"segments": 0, "records": 0},
    "rotten": {"waiting": 0, "unhealed": 0, "healed": 0},
    "unsettled": {"records": 0, "pieces": 0, "read": True},
    "unrecovered": {"pieces": 0, "share": 0.0},
    "shortages": [],
    "repair": {"segments": 0, "records": 0, "bytes": 0, "bytes_per_s": 0.0, "seconds": 0.0},
    "held": {"segments": 6, "whole": 6},
}
LACKING = {"under_copied": {"segments": 2, "missing_max": 1, "records": 40}}
FILLING = {"repair": {"segments": 2, "records": 30, "bytes": 3_000, "bytes_per_s": 1_000.0, "seconds": 3.0}}


def copies(**changes: Any) -> dict[str, Any]:
    return {**copy.deepcopy(SOUND), **changes}


def nodes(first: dict[str, Any] | None = None, **changes: Any) -> list[NodeState]:
    told = [copies(), copies(), copies()] if first is None else [first, copies(), copies()]
    pieces = (arc(0, 0.25), arc(0.25, 0.5), arc(0.5, 1))
    return [
        node(address, piece, copies=one, **(changes if not index else {}))
        for index, (address, piece, one) in enumerate(zip(ADDRESSES, pieces, told, strict=True))
    ]


def health(*found: NodeState) -> ClusterHealth:
    return health_of(status_of(list(found)))


def kinds(found: ClusterHealth) -> list[str]:
    return [ailment.kind for ailment in found.ailments]


def test_a_cluster_in_order_is_healthy_now() -> None:
    found = health(*nodes())
    assert (found.condition, found.seconds_to_health, found.ailments) == (Condition.HEALTHY, 0.0, ())
    document = json.loads(json.dumps(found.document()))
    assert (document["status"], document["records"], document["records_with_copies"]) == ("healthy", 360, 300)
    assert all(document[key] == 0 for key in ("under_copied", "mis_placed", "corrupt", "pending", "unrecovered", "seconds_to_health"))
    assert [one["address"] for one in document["nodes"]] == list(ADDRESSES)


def test_a_silent_node_degrades_and_nobody_knows_for_how_long() -> None:
    first, second, _ = nodes(copies(**LACKING))
    found = health(first, second, missing(ADDRESSES[2], arc(0.5, 1)))
    assert (found.condition, found.seconds_to_health, found.under_copied) == (Condition.DEGRADED, None, 40)
    assert kinds(found) == ["missing", "under-copied"]
    assert f"start {ADDRESSES[2]}" in found.ailments[1].to_do
    assert found.document()["nodes"][2] == {
        "address": ADDRESSES[2], "alive": False, "share": 0.5, "copies": None, "paused": None, "damaged": None, "strays": None, "strays_more": None,
        "kept_apart": None, "scrub": None,
    }  # fmt: skip


def test_what_is_being_copied_is_degraded_and_known_to_end() -> None:
    found = health(*nodes(copies(**LACKING, **FILLING)))
    assert (found.condition, found.seconds_to_health) == (Condition.DEGRADED, 3.0)
    assert found.ailments[0].mends_itself and "40 of 100 records" in found.ailments[0].text and "1 copy fewer" in found.ailments[0].text
    not_yet = health(*nodes(copies(**LACKING)))
    assert not_yet.seconds_to_health is None, "nobody knows how much is to be moved before it was compared"
    stuck = health(*nodes(copies(**LACKING, repair={**FILLING["repair"], "bytes_per_s": 0.0, "seconds": None})))
    assert stuck.seconds_to_health is None


@pytest.mark.parametrize(
    ("change", "kind", "pending"),
    [
        ({"mis_placed": {"segments": 1, "records": 7}}, "mis-placed", 0),
        ({"comparing": {"segments": 1, "records": 7}}, "comparing", 7),
        ({"owed": {"records": 7, "records_to_silent": 0, "nodes": []}}, "pending", 7),
        ({"unsettled": {"records": 7, "pieces": 0, "read": True}}, "unsettled", 7),
        ({"under_copied": {"segments": 1, "missing_max": 2, "records": 0}}, "placing", 0),
    ],
)
def test_what_costs_no_copy_is_mending(change: dict[str, Any], kind: str, pending: int) -> None:
    found = health(*nodes(copies(**change)))
    assert (found.condition, kinds(found), found.pending) == (Condition.MENDING, [kind], pending)
    assert found.ailments[0].mends_itself and not found.ailments[0].degrades


def test_who_had_no_room_for_copies_is_told() -> None:
    found = health(*nodes(copies(full=["127.0.0.9"])))
    assert (kinds(found), found.ailments[0].degrades) == (["no room"], False)
    assert found.condition is not Condition.DEGRADED and "127.0.0.9" in found.ailments[0].text


def test_strays_are_pending() -> None:
    found = health(*nodes(strays=3))
    assert (found.condition, kinds(found), found.pending) == (Condition.MENDING, ["strays"], 3)
    assert "3 records that belong elsewhere" in found.ailments[0].text


def test_strays_that_were_not_all_counted_are_so_many_or_more() -> None:
    found = health(*nodes(strays=1_000, strays_more=True))
    assert "1,000 or more records that belong elsewhere" in found.ailments[0].text
    assert "holds 1,000 or more records" in next(warning.text for warning in found.status.warnings if warning.kind == "strays")
    assert [(one["strays"], one["strays_more"]) for one in found.document()["nodes"]][:2] == [(1_000, True), (0, False)]


def owed_to(address: str) -> dict[str, Any]:
    return copies(owed={"records": 9, "records_to_silent": 4, "nodes": [{"address": address, "records": 4, "alive": False}]})


def test_what_is_owed_to_the_silent_is_pending_too() -> None:
    first, second, _ = nodes(owed_to(ADDRESSES[2]))
    found = health(first, second, missing(ADDRESSES[2], arc(0.5, 1)))
    (owed,) = [ailment for ailment in found.ailments if ailment.kind == "owed"]
    assert (found.pending, owed.degrades, owed.mends_itself) == (9, True, False)
    assert owed.to_do.startswith(f"start {ADDRESSES[2]}, ")


def test_nobody_is_told_to_start_a_node_that_was_removed() -> None:
    found = health(*nodes(owed_to("127.0.0.99")))
    (owed,) = [ailment for ailment in found.ailments if ailment.kind == "owed"]
    assert (found.condition, found.pending, owed.degrades, owed.mends_itself) == (Condition.MENDING, 9, False, True)
    assert "start" not in owed.to_do and "127.0.0.99, which was removed" in owed.to_do


def test_founders_that_never_came_are_told_of_and_not_counted_as_if_there_were_none() -> None:
    refusing = {"shortages": [{"copies": 3, "needed": needed, "possible": 1, "blacklist_of": None} for needed in (4, 2)]}
    founders = [NodeState(address, NEVER_CAME, False, None, None, None, "no connection") for address in ADDRESSES[1:]]
    found = health(node(ADDRESSES[0], arc(0, 1), copies=copies(**refusing)), *founders)
    (few,) = [ailment for ailment in found.ailments if ailment.kind == "too few nodes"]
    assert "the cluster has one node that has come, and waits for 2 more" in few.text
    assert "writes are refused in spaces that need more than 1" in few.text, "whatever the others need"


NAMED = [{"address": "127.0.0.9", "pieces": 8192}]


@pytest.mark.parametrize(
    ("change", "kind", "word"),
    [
        ({"owed": {"records": 9, "records_to_silent": 4, "nodes": [{"address": ADDRESSES[2], "records": 4, "alive": False}]}}, "owed", ADDRESSES[2]),
        ({"forbidden": {"segments": 1, "records": 5, "nodes": ["127.0.0.9"]}}, "forbidden", "127.0.0.9"),
        ({"unrecovered": {"pieces": 1, "share": 0.25}}, "unrecovered", "25.0%"),
        ({"unrecovered": {"pieces": 1, "share": 0.25, "named_most": NAMED}}, "unrecovered", "most of them by 127.0.0.9 (8,192)"),
        ({"shortages": [{"copies": 3, "needed": 2, "possible": 1, "blacklist_of": None}]}, "too few nodes", "refused in spaces that need more than 1"),
        ({"shortages": [{"copies": 3, "needed": 2, "possible": 2, "blacklist_of": "127.0.0.2"}]}, "too few nodes", "blacklist of 127.0.0.2"),
    ],
)  # fmt: skip
def test_what_may_lose_something_degrades(change: dict[str, Any], kind: str, word: str) -> None:
    found = health(*nodes(copies(**change)))
    assert (found.condition, found.seconds_to_health, found.ailments[0].kind) == (Condition.DEGRADED, None, kind)
    assert word in found.ailments[0].text and found.ailments[0].to_do


def test_nobody_is_told_to_wait_for_a_node_that_names_more_than_there_can_be() -> None:
    (ailment,) = health(*nodes(copies(unrecovered={"pieces": 1, "share": 0.25, "named_most": NAMED}))).ailments
    assert not ailment.mends_itself and "cluster revoke" in ailment.to_do


FEW = {
    "shortages": [{"copies": 3, "needed": 1, "possible": 1, "blacklist_of": None}],
    "under_copied": {"segments": 1, "missing_max": 2, "records": 100},
}


def test_a_cluster_of_one_node_hears_once_how_many_nodes_to_add() -> None:
    alone = node(ADDRESSES[0], arc(0, 1), copies=copies(**FEW))
    found = health(alone)
    assert (found.condition, kinds(found), found.under_copied) == (Condition.DEGRADED, ["too few nodes"], 100)
    (ailment,) = found.ailments
    assert (
        ailment.text
        == "in spaces with 3 copies only 1 of them can be there: the cluster has one node, and what lies on its disk is lost with it"
    )
    assert ailment.to_do.startswith("add 2 nodes, and the copies are made: scenectl cluster invite")
    assert (found.shortage is not None and found.shortage.missing, found.seconds_to_health) == (2, None)


def test_what_too_few_nodes_do_not_explain_is_told_beside_it() -> None:
    short = {"shortages": [{"copies": 3, "needed": 2, "possible": 2, "blacklist_of": None}]}
    pair = [node(ADDRESSES[index], arc(index / 2, (index + 1) / 2), copies=copies(**FEW | short)) for index in range(2)]
    found = health(*pair)
    assert kinds(found) == ["too few nodes", "under-copied", "under-copied"], "once for both, and each lacks what two nodes could have"
    assert "add a node" in found.ailments[0].to_do
    explained = {**short, "under_copied": {"segments": 1, "missing_max": 1, "records": 100}}
    assert kinds(health(*(node(one.address, one.arc, copies=copies(**explained)) for one in pair))) == ["too few nodes"]


def test_nobody_is_told_to_wait_for_copies_that_too_few_nodes_can_hold_where_there_are_no_records_either() -> None:
    """As with a new scene in a cluster of one node, or a space of which a blacklist forbids too many."""
    empty = {**FEW, "under_copied": {"segments": 1, "missing_max": 2, "records": 0}}
    assert kinds(health(node(ADDRESSES[0], arc(0, 1), copies=copies(**empty)))) == ["too few nodes"]
    more = {**empty, "under_copied": {"segments": 1, "missing_max": 3, "records": 0}}
    assert kinds(health(node(ADDRESSES[0], arc(0, 1), copies=copies(**more)))) == ["too few nodes", "placing"]


def test_the_status_tells_of_too_few_nodes_and_is_degraded_only_if_writes_are_refused() -> None:
    found = status_of([node(ADDRESSES[0], arc(0, 1), copies=copies(**FEW))])
    assert [warning.kind for warning in found.warnings] == ["too few nodes"] and not found.degraded
    refusing = {"shortages": [{"copies": 3, "needed": 2, "possible": 1, "blacklist_of": None}]}
    assert status_of([node(ADDRESSES[0], arc(0, 1), copies=copies(**refusing))]).degraded
    assert kinds(health(node(ADDRESSES[0], arc(0, 1), copies=copies(**refusing)))) == ["too few nodes"], "once"


def test_a_blacklist_that_forbids_too_much_is_told_once() -> None:
    """Spaces may have different numbers of copies; what there is to do about it is one thing."""
    shortages = [
        {"copies": copies, "needed": needed, "possible": 1, "blacklist_of": ADDRESSES[0]} for copies, needed in ((3, 2), (5, 1), (2, 2))
    ]
    found = health(*nodes(copies(shortages=shortages)))
    assert kinds(found) == ["too few nodes"]
    assert (
        found.ailments[0].text.startswith(f"of what {ADDRESSES[0]} owns, in spaces with 2, 3 or 5 copies only 1 of them can be there")
        and "writes are refused in spaces that need more than 1" in found.ailments[0].text
    )


FORBIDDING = {
    "shortages": [{"copies": 3, "needed": 2, "possible": 1, "blacklist_of": ADDRESSES[0]}],
    "forbidden": {"segments": 2, "records": 9, "nodes": list(ADDRESSES[1:])},
    "by_copies": [{"copies": 3, "records": 9, "under_copied": 0, "missing_max": 0, "forbidden": 9}],
}


def forbidding(*prefixes: str, **changes: Any) -> list[NodeState]:
    """Nodes, of which the first has these on its blacklist."""
    first, *others = nodes(copies(**FORBIDDING, **changes))
    return [replace(first, blacklist=prefixes), *others]


def waits(found: ClusterHealth) -> list[str]:
    """What is said to come by itself."""
    return [ailment.kind for ailment in found.ailments if ailment.mends_itself or ailment.to_do.startswith("wait")]


def test_the_entry_that_forbids_all_holders_is_named_with_how_to_take_it_off() -> None:
    found = health(*forbidding("10.0.0.0/8", "127.0.0.0/8"))
    few, forbidden = found.ailments
    assert f"127.0.0.0/8 on its blacklist forbids {', '.join(ADDRESSES[1:])}, and writes are refused" in few.text
    assert "10.0.0.0/8" not in few.text + few.to_do, "it forbids no node of the cluster"
    assert f"scenectl node blacklist rm 127.0.0.0/8 --node {ADDRESSES[0]}; or add 2 nodes that it allows" in few.to_do
    assert forbidden.kind == "forbidden" and "nobody may take their place" in forbidden.text and waits(found) == []
    assert found.seconds_to_health is None


def test_where_the_entry_covers_every_address_nobody_is_sent_to_add_nodes() -> None:
    few, _ = health(*forbidding("0.0.0.0/0")).ailments
    assert f"blacklist rm 0.0.0.0/0 --node {ADDRESSES[0]} (no node that is added would be allowed)" in few.to_do
    assert "add 2 nodes" not in few.to_do


def test_forbidden_copies_that_others_may_take_over_go_by_waiting_whatever_another_space_lacks() -> None:
    """A space with 5 copies has too few nodes; that keeps no copy of one with 3 where it lies."""
    row = {"records": 9, "under_copied": 0, "missing_max": 0, "forbidden": 0}
    told = {"by_copies": [{**row, "copies": 3, "forbidden": 9}, {**row, "copies": 5, "under_copied": 9, "missing_max": 1}]}
    few = {"shortages": [{"copies": 5, "needed": 2, "possible": 4, "blacklist_of": ADDRESSES[0]}]}
    found = health(*nodes(copies(**FORBIDDING | told | few)))
    assert kinds(found) == ["too few nodes", "forbidden"] and waits(found) == ["forbidden"]


def test_strays_and_the_unsettled_are_not_said_to_come_home_where_too_few_may_hold_them() -> None:
    unsettled = {"unsettled": {"records": 3, "pieces": 0, "read": True}}
    first, second, third = forbidding("127.0.0.0/8", **unsettled)
    bringing = node(second.address, second.arc, copies=copies(), strays=2)
    found = health(first, bringing, third)
    assert {"strays", "unsettled"} <= set(kinds(found)) and waits(found) == []
    assert all(ADDRESSES[0] in ailment.to_do for ailment in found.ailments if ailment.kind in ("strays", "unsettled"))


def test_the_most_demanding_space_of_a_layout_says_whether_writes_are_refused() -> None:
    """Spaces with as many copies may need different numbers of nodes for a write."""
    shortage = {"copies": 3, "needed": 1, "needed_most": 2, "possible": 1, "blacklist_of": ADDRESSES[0]}
    found = health(*nodes(copies(shortages=[shortage])))
    assert "writes are refused in spaces that need more than 1" in found.ailments[0].text


def test_what_one_space_lacks_is_not_explained_by_what_another_one_may_not_have() -> None:
    """Two copies fewer for want of nodes where 5 are asked for; one fewer where 2 are, and these could be there."""
    few = {"shortages": [{"copies": 5, "needed": 2, "possible": 3, "blacklist_of": None}]}
    rows = [
        {"copies": 2, "records": 30, "under_copied": 10, "missing_max": 1, "forbidden": 0},
        {"copies": 5, "records": 20, "under_copied": 20, "missing_max": 2, "forbidden": 0},
    ]
    lacking = {"under_copied": {"segments": 2, "missing_max": 2, "records": 30}, "by_copies": rows}
    found = health(*nodes(copies(**few, **lacking)))
    assert kinds(found) == ["too few nodes", "under-copied"]
    few_nodes, lacks = found.ailments
    assert few_nodes.text.startswith("in spaces with 5 copies only 3 of them can be there: the cluster has 3 nodes")
    assert "10 of 30 records in spaces with 2 copies lie on fewer nodes than they should, up to 1 copy fewer" in lacks.text
    assert lacks.mends_itself and lacks.to_do.startswith("wait")
    assert found.document()["by_copies"] == rows
    assert found.document()["nodes"][0]["copies"]["by_copies"] == rows


def test_where_nobody_has_room_for_what_is_missing_nobody_is_told_to_wait() -> None:
    row = {"copies": 3, "records": 30, "under_copied": 30, "missing_max": 1, "forbidden": 0}
    lacking = {"under_copied": {"segments": 1, "missing_max": 1, "records": 30}, "by_copies": [row]}
    full = health(*nodes(copies(**lacking, full=[ADDRESSES[1]])))
    assert waits(full) == [] and ADDRESSES[1] in full.ailments[0].to_do and "--capacity" in full.ailments[0].to_do
    fourth = node("127.0.0.5", arc(0.9, 1), copies=copies())
    with_room = health(*nodes(copies(**lacking, full=[ADDRESSES[1]]))[:2], node(ADDRESSES[2], arc(0.5, 0.9), copies=copies()), fourth)
    assert waits(with_room) == ["under-copied"], "another one takes them"


def test_nobody_is_told_to_wait_until_a_node_is_removed_that_never_is() -> None:
    """Who decides the cluster's log is never removed; and where more than half are away nobody is."""
    first, second, third = nodes(copies(**LACKING))
    voter = replace(first, report=None, is_voter=True)
    away = health(voter, node(second.address, second.arc, copies=copies(**LACKING)), third)
    assert {"missing", "under-copied"} <= set(kinds(away))
    assert not any("wait" in ailment.to_do for ailment in away.ailments)
    most = health(first, missing(ADDRESSES[1], second.arc), missing(ADDRESSES[2], third.arc))
    assert not any("wait" in ailment.to_do for ailment in most.ailments)
    one = health(replace(first, is_voter=True), second, missing(ADDRESSES[2], third.arc))
    assert all("wait until" in ailment.to_do for ailment in one.ailments), "else this test says nothing"


def test_nodes_that_own_nothing_yet_are_told_of_where_copies_fail_for_want_of_nodes() -> None:
    short = {"shortages": [{"copies": 3, "needed": 2, "possible": 2, "blacklist_of": None}]}
    first, second, _ = nodes(copies(**short))
    found = health(first, node(second.address, arc(0.25, 1), copies=copies()), node(ADDRESSES[2], None, copies=copies()))
    assert f"the cluster has 2 nodes that own a part of the line; {ADDRESSES[2]} owns none" in found.ailments[0].text


def test_what_has_rotted_degrades_until_it_is_healed() -> None:
    found = health(*nodes(copies(rotten={"waiting": 2, "unhealed": 0, "healed": 0}), damaged=9))
    assert (found.condition, found.corrupt, kinds(found)) == (Condition.DEGRADED, 2, ["rotten"])
    assert found.ailments[0].mends_itself
    given_up = health(*nodes(copies(rotten={"waiting": 1, "unhealed": 1, "healed": 0})))
    assert (given_up.corrupt, given_up.ailments[0].mends_itself) == (2, False)
    healed = health(*nodes(copies(rotten={"waiting": 0, "unhealed": 0, "healed": 2}), damaged=9))
    assert healed.condition is Condition.HEALTHY


def test_a_pause_is_shown_and_nobody_believes_that_time_mends_what_waits_for_its_end() -> None:
    paused = {"upkeep": {"paused": ["repair", "scrub"]}}
    well = health(*nodes(**paused))
    assert well.condition is Condition.HEALTHY
    assert [one["paused"] for one in well.document()["nodes"]] == [["repair", "scrub"], [], []]
    found = health(*nodes(copies(**LACKING, **FILLING), **paused))
    assert (found.condition, found.seconds_to_health) == (Condition.DEGRADED, None)
    assert not found.ailments[0].mends_itself and f"scenectl node upkeep resume {ADDRESSES[0]}" in found.ailments[0].to_do
    scrub_alone = health(*nodes(copies(**LACKING, **FILLING), upkeep={"paused": ["scrub"]}))
    assert scrub_alone.seconds_to_health == 3.0
    settling = health(*nodes(copies(unsettled={"records": 3, "pieces": 0, "read": True}), **paused))
    assert settling.ailments[0].mends_itself, "that goes on"


def test_how_far_the_scrub_is_is_shown() -> None:
    scrub = {"round": 2, "fraction": 0.5, "bytes_per_s": 9.0, "seconds_left": 60.0, "rotten": 1, "rotten_before": 0, "paused": False}
    shown = health(*nodes(scrub=scrub)).document()["nodes"]
    assert (shown[0]["scrub"]["fraction"], shown[0]["scrub"]["rotten"], shown[1]["scrub"]) == (0.5, 1, None)


def test_a_node_that_says_nothing_of_copies_degrades() -> None:
    old = node(ADDRESSES[0], arc(0, 0.25))
    assert kinds(health(old, *nodes()[1:])) == ["unknown"]


@pytest.mark.parametrize(
    "nonsense",
    [
        {"owned": {"records": -1, "records_with_copies": 0}},
        {"owed": {"records": 1, "records_to_silent": 1, "nodes": [{"address": "\x1b[2J", "records": 1, "alive": False}]}},
        {"owed": {"records": 1, "records_to_silent": 1, "nodes": [{"address": "127.0.0.9", "records": 1, "alive": False}] * 65}},
        {"repair": None},
        {"unrecovered": {"pieces": 1, "share": float("inf")}},
        {"unrecovered": {"pieces": 1, "share": 0.5, "named_most": [{"address": "127.0.0.9", "pieces": 1}] * 65}},
    ],
)
def test_nonsense_of_a_node_is_no_report(nonsense: dict[str, Any]) -> None:
    with pytest.raises(PeerFault):
        report(ADDRESSES[0], arc(0, 1), copies=copies(**nonsense))


LOSS = {
    "id": "0f" * 16,
    "noted_by": ADDRESSES[0],
    "noted_s": 1_800_000_000.0,
    "copies": 3,
    "complete_copy_left": False,
    "share": 0.125,
    "removed": ["127.0.0.8", "127.0.0.9"],
}


def test_what_may_be_lost_degrades_until_it_is_acknowledged_and_is_told_once() -> None:
    first, second, third = (
        node(address, piece, copies=copies(lost=[LOSS]))
        for address, piece in zip(ADDRESSES, (arc(0, 0.25), arc(0.25, 0.5), arc(0.5, 1)), strict=True)
    )
    found = health(first, second, third)
    assert (found.condition, found.seconds_to_health, kinds(found)) == (Condition.DEGRADED, None, ["lost"])
    (ailment,) = found.ailments
    assert ailment.address == ADDRESSES[0] and not ailment.mends_itself
    assert (
        "12.50% of the line" in ailment.text
        and "no complete copy of it was left" in ailment.text
        and "127.0.0.8, 127.0.0.9" in ailment.text
    )
    assert "with their disks" in ailment.to_do and "--acknowledge" in ailment.to_do
    (told,) = found.document()["lost"]
    assert told == LOSS
    (less,) = health(*nodes(copies(lost=[{**LOSS, "complete_copy_left": True}]))).ailments
    assert "what was acknowledged last" in less.text


async def test_a_node_that_dies_holds_up_no_acknowledgement_by_others() -> None:
    asked: list[str] = []

    async def ask(address: str, packet: AcknowledgeLosses, _reply: object, *, priority: Priority) -> LossesKept:
        assert packet.ids == (bytes.fromhex(LOSS["id"]),) and priority is Priority.HIGH
        asked.append(address)
        if address == ADDRESSES[0]:
            raise Unreachable("it has just died", where=address)
        return LossesKept(())

    cluster: Any = SimpleNamespace(calls=SimpleNamespace(ask=ask))
    await Cluster.acknowledge_losses(cluster, health(*nodes(copies(lost=[LOSS]))))
    assert asked == list(ADDRESSES[: len(asked)]) and len(asked) > 1


async def test_one_that_takes_no_acknowledgement_keeps_none_of_the_others_from_it_and_is_named() -> None:
    asked: list[str] = []

    async def ask(address: str, _packet: AcknowledgeLosses, _reply: object, *, priority: Priority) -> LossesKept:
        asked.append(address)
        if address == ADDRESSES[0]:
            raise Refused(RejectReason.STORAGE_FULL, "the disk is full", where=address)
        return LossesKept(())

    cluster: Any = SimpleNamespace(calls=SimpleNamespace(ask=ask))
    with pytest.raises(Refused, match="the disk is full"):
        await Cluster.acknowledge_losses(cluster, health(*nodes(copies(lost=[LOSS]))))
    assert asked == list(ADDRESSES[: len(asked)]) and len(asked) > 1


async def test_more_than_one_node_keeps_are_acknowledged_in_parts() -> None:
    """Where nodes keep different ones, as when one that lies has told each something else."""
    asked: dict[str, list[bytes]] = {}

    async def ask(address: str, packet: AcknowledgeLosses, _reply: object, *, priority: Priority) -> LossesKept:
        encode_packet(packet)
        asked.setdefault(address, []).extend(packet.ids)
        return LossesKept(())

    one, *others = nodes(copies(lost=[{**LOSS, "id": f"{number:032x}"} for number in range(LOSSES_KEPT_MAX)]))
    more, *_ = nodes(copies(lost=[LOSS]))
    found = health(one, replace(others[0], report=more.report))
    cluster: Any = SimpleNamespace(calls=SimpleNamespace(ask=ask))
    await Cluster.acknowledge_losses(cluster, found)
    assert len(found.losses) == LOSSES_KEPT_MAX + 1
    assert list(asked.values()) == [[bytes.fromhex(loss.id) for loss in found.losses]] * 2


@pytest.mark.parametrize("wrong", [{"id": "0"}, {"id": 7}, {"share": "much"}, {"removed": ["x"]}, {"complete_copy_left": 1}])
def test_a_loss_that_makes_no_sense_is_no_report(wrong: dict[str, Any]) -> None:
    with pytest.raises((PeerFault, ValueError, TypeError)):
        nodes(copies(lost=[{**LOSS, **wrong}]))
