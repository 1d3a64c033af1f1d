"""If this fails, `cluster status` says that all is well while a part of the line is nobody's, or cries wolf when bounds move."""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenefold.base.errors import PeerFault
from scenefold.base.ids import node_id_of
from scenefold.base.location import FIRST, LAST, LINE_LENGTH, Arc, Location
from scenefold.client.health import ClusterStatus, NodeState, judged, line_warnings, voter_warnings
from scenefold.client.moving import movements, rates
from scenefold.client.own_warnings import own_warnings
from scenefold.client.reports import NodeReport, read_drain_report, read_report
from scenefold.wire import pack_value

SIGN = {"count": 3, "ago_s": 12.0, "source": "127.0.0.9"}
ADDRESSES = ("127.0.0.2", "127.0.0.3", "127.0.0.4")


def place(number: float) -> Location:
    return Location.from_number(int(number * LINE_LENGTH))


def arc(begin: float, end: float) -> Arc:
    """From `begin` to just before `end`, as parts of the line."""
    return Arc(place(begin), LAST if end == 1 else Location.from_number(place(end).number - 1))


def arc_document(piece: Arc | None) -> dict[str, str] | None:
    return None if piece is None else {"first": piece.first.hex(), "last": piece.last.hex()}


def report_document(address: str, piece: Arc | None, **changes: Any) -> dict[str, Any]:
    document: dict[str, Any] = {
        "node": 1,
        "incarnation": "ab" * 16,
        "boot": 1,
        "seconds_up": 9.0,
        "role": "member",
        "lease_s": 9.0,
        "log_position": 5,
        "arc": arc_document(piece),
        "gap": None,
        "handovers": [],
        "strays": 0,
        "damaged": 0,
        "records": 10,
        "bytes": 1_000,
        "used_bytes": 2_000,
        "capacity_bytes": 10_000,
        "memory_fraction": 0.5,
        "rays_per_second": 0,
        "stalls": {"count": 0, "last_s": 0.0, "ago_s": None},
        "peers": [{"address": other, "heard_s": 1.0, "alive": True} for other in ADDRESSES if other != address],
        "something newer": [1, 2],
    }
    return {**document, **changes}


def report(address: str, piece: Arc | None, **changes: Any) -> NodeReport:
    return read_report(pack_value(report_document(address, piece, **changes)), address)


def handover(piece: Arc, peer: str, *, step: str = "offered", seconds: float = 3.0, records: int = 0) -> dict[str, Any]:
    gives = step in ("offered", "released", "given")
    is_open = step in ("offered", "released", "noted")
    known = {"id": "0a" * 16, "side": "right", "step": step, "gives": gives, "peer": peer, "open": is_open}
    return {**known, "first": piece.first.hex(), "last": piece.last.hex(), "seconds": seconds, "records": records, "bytes": 10 * records}


def node(address: str, piece: Arc | None, *, is_voter: bool = False, **changes: Any) -> NodeState:
    return NodeState(address, bytes([1]) * 16, is_voter, piece, 1.0, report(address, piece, **changes))


def missing(address: str, piece: Arc | None, *, is_voter: bool = False) -> NodeState:
    return NodeState(address, bytes([1]) * 16, is_voter, piece, 40.0, None, "no connection")


def thirds() -> list[NodeState]:
    return [node(address, arc(index / 4, (index + 1) / 4 if index < 2 else 1)) for index, address in enumerate(ADDRESSES)]


@pytest.mark.parametrize(("living", "left"), [(arc(0.4, 1), arc(0.25, 0.4)), (arc(0, 0.3), arc(0.3, 0.5)), (arc(0.2, 0.6), None)])
def test_of_a_silent_nodes_arc_what_a_living_one_owns_is_not_counted_twice(living: Arc, left: Arc | None) -> None:
    found = judged("c", ADDRESSES[0], [missing(ADDRESSES[0], arc(0.25, 0.5)), node(ADDRESSES[1], living)])
    assert found.nodes[0].arc == left and found.nodes[1].arc == living
    assert sum(one.share for one in found.nodes) <= 1 and "overlap" not in [warning.kind for warning in found.warnings]


def status_of(nodes: list[NodeState]) -> ClusterStatus:
    return judged("studio", ADDRESSES[0], nodes)


def kinds(nodes: list[NodeState]) -> list[str]:
    return [warning.kind for warning in status_of(nodes).warnings]


def test_a_cluster_in_order_is_not_complained_about() -> None:
    found = status_of(thirds())
    assert found.warnings == () and not found.degraded and not found.is_unsteady
    assert found.document()["nodes"][0]["disk_fraction"] == 0.2


@given(st.lists(st.integers(1, LINE_LENGTH - 1), max_size=6, unique=True).map(sorted), st.data())
def test_a_line_is_tiled_or_it_is_said_where_it_is_not(cuts: list[int], data: st.DataObject) -> None:
    bounds = [0, *cuts, LINE_LENGTH]
    arcs = [Arc(Location.from_number(begin), Location.from_number(end - 1)) for begin, end in pairwise(bounds)]
    nodes = [node(f"127.0.0.{index + 2}", piece) for index, piece in enumerate(arcs)]
    assert line_warnings(nodes) == []
    index = data.draw(st.integers(0, len(arcs) - 1))
    gone = [replace(one, report=report(one.address, None)) if at == index else one for at, one in enumerate(nodes)]
    assert [warning.kind for warning in line_warnings(gone)] == ["gap"]
    twice = [*nodes[: index + 1], node("127.0.0.99", arcs[index]), *nodes[index + 1 :]]
    assert [warning.kind for warning in line_warnings(twice)] == ["overlap"]
    assert all(warning.degrades for warning in (*line_warnings(gone), *line_warnings(twice)))


@pytest.mark.parametrize("step", ["released", "given"])
def test_what_is_being_handed_over_is_neither_gap_nor_overlap(step: str) -> None:
    piece = arc(0.2, 0.25)
    giver = node(ADDRESSES[0], arc(0, 0.2), handovers=[handover(piece, ADDRESSES[1], step=step)])
    assert kinds([giver, *thirds()[1:]]) == [], "released and not claimed yet"
    taker = node(ADDRESSES[1], arc(0.2, 0.5), handovers=[handover(piece, ADDRESSES[0], step="taken")])
    assert kinds([thirds()[0], taker, thirds()[2]]) == [], "claimed since the giver was asked"


def test_a_silent_node_counts_with_what_it_was_last_heard_to_own() -> None:
    nodes = [thirds()[0], missing(ADDRESSES[1], arc(0.1, 0.5)), thirds()[2]]
    found = status_of(nodes)
    assert [warning.kind for warning in found.warnings] == ["missing"], "what it owns by now nobody can say: no overlap"
    assert found.degraded and "does not answer" in found.warnings[0].text
    assert found.nodes[1].document()["records"] is None and found.nodes[1].document()["heard_s"] == 40
    assert "nobody can join" in status_of([missing(ADDRESSES[0], arc(0, 0.25), is_voter=True), *thirds()[1:]]).warnings[0].text


def test_what_a_silent_node_may_have_taken_is_not_called_nobodys() -> None:
    """Who fell silent just after it took its piece is known to nobody as its owner."""
    left, _, right = thirds()
    taken = [left, missing(ADDRESSES[1], None), right]
    gap = next(warning for warning in status_of(taken).warnings if warning.kind == "gap")
    assert gap.text.startswith("nobody who answers owns 40000000..7fffffff (25.00% of the line), left of 127.0.0.4; ")
    assert gap.text.endswith("127.0.0.3, which does not answer, may: start it, or wait for its removal") and gap.degrades
    grown = [missing(ADDRESSES[0], arc(0, 0.1), is_voter=True), missing(ADDRESSES[1], None), right]
    gap = next(warning for warning in line_warnings(grown) if warning.kind == "gap")
    assert gap.text.endswith("127.0.0.2, 127.0.0.3, which do not answer, may: start them"), "the voter is never removed"
    at_the_end = [left, node(ADDRESSES[1], arc(0.25, 0.5)), missing(ADDRESSES[2], None)]
    assert (
        "nobody who answers owns 80000000" in line_warnings(at_the_end)[0].text and "127.0.0.4, which" in line_warnings(at_the_end)[0].text
    )
    elsewhere = [left, right, missing(ADDRESSES[1], None)]
    assert line_warnings(elsewhere)[0].text.startswith("nobody owns "), "the order of the line says who cannot"


def test_a_founder_that_never_came_is_awaited() -> None:
    founder = replace(missing(ADDRESSES[2], arc(0.5, 1)), incarnation=bytes(16), heard_s=None)
    assert founder.role == "awaited"
    assert kinds([*thirds()[:2], founder]) == ["awaited"]


@pytest.mark.parametrize(
    "changes, kind, degrades",
    [
        ({"lease_s": 0.0}, "no lease", True),
        ({"log_position": 3}, "behind", False),
        ({"strays": 7}, "strays", False),
        ({"damaged": 1}, "damaged", True),
        ({"used_bytes": 9_100}, "nearly full", True),
        ({"stalls": {"count": 2, "last_s": 300.0, "ago_s": 12.0}}, "stalled", False),
        *(({"signs": [{**SIGN, "kind": kind}]}, kind, False) for kind in ("own key", "contested", "forged")),
        ({"handovers": [handover(arc(0.2, 0.25), ADDRESSES[1], seconds=61)]}, "handover", False),
        ({"handovers": [handover(arc(0.2, 0.25), ADDRESSES[1], step="released", seconds=61)]}, "handover", True),
        ({"handovers": [{**handover(arc(0.2, 0.25), ADDRESSES[1], step="released"), "peer_removed": True}]}, "handover", True),
        ({"peers": [{"address": ADDRESSES[1], "heard_s": 50.0, "alive": False}]}, "deaf", False),
    ],
)
def test_what_is_off_at_a_node_is_said(changes: dict[str, Any], kind: str, degrades: bool) -> None:
    first, *others = thirds()
    found = status_of([node(first.address, first.arc, **changes), *others])
    assert [(warning.kind, warning.degrades, warning.address) for warning in found.warnings] == [(kind, degrades, first.address)]
    assert found.degraded == degrades


def test_a_newcomer_without_an_arc_is_no_fault() -> None:
    newcomer = node("127.0.0.9", None, role="joining", lease_s=0.0)
    found = status_of([*thirds()[:1], newcomer, *thirds()[1:]])
    assert [warning.kind for warning in found.warnings] == ["joining"] and not found.degraded
    assert newcomer.share == 0


def test_giver_and_receiver_tell_together_how_far_a_handover_is() -> None:
    piece = arc(0.2, 0.25)
    giver = node(ADDRESSES[0], arc(0, 0.25), handovers=[handover(piece, ADDRESSES[1], records=200)])
    taker = node(ADDRESSES[1], arc(0.25, 0.5), handovers=[handover(piece, ADDRESSES[0], step="noted", records=50)])
    (both,) = movements([giver, taker])
    assert (both.giver, both.receiver, both.step, both.progress) == (ADDRESSES[0], ADDRESSES[1], "offered", 0.25)
    (alone,) = movements([taker])
    assert (alone.giver, alone.receiver, alone.records, alone.progress) == (ADDRESSES[0], ADDRESSES[1], None, 0.0)
    released = node(ADDRESSES[0], arc(0, 0.2), handovers=[handover(piece, ADDRESSES[1], step="released", records=200)])
    assert movements([released, taker])[0].progress == 1.0


def test_rates_need_two_answers() -> None:
    before = [node(ADDRESSES[0], arc(0, 0.5)), missing(ADDRESSES[1], arc(0.5, 1))]
    after = [node(ADDRESSES[0], arc(0, 0.5), records=30, bytes=500), node(ADDRESSES[1], arc(0.5, 1))]
    first, second = rates(before, after, 2.0)
    assert (first.records_per_second, first.bytes_per_second) == (10.0, -250.0)
    assert (second.records_per_second, second.bytes_per_second) == (None, None)


@pytest.mark.parametrize("document", [{}, [], None, {"node": "x"}, {"state": 1}])
def test_a_report_that_is_none_is_its_senders_fault(document: Any) -> None:
    for read in (read_report, read_drain_report):
        with pytest.raises(PeerFault, match="cannot be read"):
            read(pack_value(document), ADDRESSES[0])
    with pytest.raises(PeerFault, match="cannot be read"):
        read_report(b"\xc1", ADDRESSES[0])


MADE_UP = (None, True, -1, 2**64 - 1, -(2**63), math.inf, -math.inf, 1e308, 0.5, "", "x", "9" * 30, "1e400", b"ab", [], {}, [1], {"a": 1})


def _places(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    yield path
    for key in value if isinstance(value, dict) else range(len(value)) if isinstance(value, list) else ():
        yield from _places(value[key], (*path, key))


def _with(document: Any, path: tuple[str | int, ...], value: Any) -> Any:
    if not path:
        return value
    changed = copy.deepcopy(document)
    inner = changed
    for key in path[:-1]:
        inner = inner[key]
    inner[path[-1]] = value
    return changed


def test_whatever_one_node_reports_the_others_are_shown() -> None:
    """Each value of a report replaced by what it cannot be: that node's fault alone, and what is printed stays JSON."""
    moving = [handover(arc(0.4, 0.5), ADDRESSES[1], records=9)]
    honest = report_document(ADDRESSES[0], arc(0, 0.5), handovers=moving)
    other = node(ADDRESSES[1], arc(0.5, 1), handovers=moving)
    for path in _places(honest):
        for value in MADE_UP:
            try:
                said = read_report(pack_value(_with(honest, path, value)), ADDRESSES[0])
            except PeerFault:
                continue
            liar = NodeState(ADDRESSES[0], bytes(16), True, None, 1.0, said)
            found = judged(
                "c", ADDRESSES[1], [liar, replace(other, heard_s=said.peers[ADDRESSES[1]].heard_s if ADDRESSES[1] in said.peers else None)]
            )
            changes, moves = rates([other], found.nodes, 1.0), movements(found.nodes)
            shown = [found.document(), *(one.document() for one in (*changes, *moves))]
            json.dumps(shown, allow_nan=False)
            assert found.best_informed in (node_id_of(ADDRESSES[0]), node_id_of(ADDRESSES[1])), (path, value)


@pytest.mark.parametrize("seconds", [math.inf, -math.inf, "9", 1e308, True])
def test_how_far_a_leaving_node_is_is_told_in_numbers(seconds: Any) -> None:
    said = {"state": "draining", "records": 1, "bytes": 9, "seconds_left": 3, "may_switch_off": False, "obstacles": [], "text": ""}
    assert read_drain_report(pack_value(said), ADDRESSES[0]).seconds_left == 3
    assert read_drain_report(pack_value(said), ADDRESSES[0]).room_bytes is None, "early nodes do not say"
    for key in ("seconds_left", "records", "bytes", "room_bytes"):
        with pytest.raises(PeerFault, match="cannot be read"):
            read_drain_report(pack_value({**said, key: seconds}), ADDRESSES[0])


def test_the_ends_of_the_line_count() -> None:
    assert [warning.kind for warning in line_warnings([])] == ["gap"]
    short = node(ADDRESSES[0], Arc(FIRST, Location.from_number(LAST.number - 1)))
    assert [warning.text.split(",")[0] for warning in line_warnings([short])] == ["nobody owns ffffffff..ffffffff (0.00% of the line)"]


def test_a_sign_of_harm_names_who_told_it_and_is_not_told_of_for_ever() -> None:
    def texts(ago_s: float, kind: str = "own key") -> list[str]:
        signs = [{**SIGN, "kind": kind, "ago_s": ago_s}] * 1000
        node = report(ADDRESSES[0], arc(0, 1), signs=signs)
        return [concern.text for concern in own_warnings(ADDRESSES[0], node, 0)]

    (text,) = texts(599.0)
    assert "signs with the key of 127.0.0.2" in text and "3 times, last 599 s ago by 127.0.0.9" in text
    assert texts(601.0) == texts(1.0, kind="of a later version") == []


@pytest.mark.parametrize(
    "text", ["127.0.0.9\nwarning: all is well", "10.1.2.3/24", "10.0.0.0/8\n", "\x1b[2J", "somebody", "127.0.0.2 ", "0.0.0.0", ""]
)
def test_addresses_in_a_report_are_addresses_and_forge_no_lines(text: str) -> None:
    assert report(ADDRESSES[0], arc(0, 1), signs=[{**SIGN, "kind": "forged"}], blacklist=["127.0.0.9", "10.1.2.0/24"]).signs
    for forged in (
        {"signs": [{**SIGN, "kind": "forged", "source": text}]},
        {"handovers": [handover(arc(0, 1), text)]},
        {"blacklist": [text]},
    ):
        with pytest.raises(PeerFault, match="cannot be read"):
            report(ADDRESSES[0], arc(0, 1), **forged)


def test_words_in_a_report_are_on_one_line() -> None:
    for forged in ({"role": "member\nwarning: x"}, {"handovers": [handover(arc(0, 1), ADDRESSES[1], step="noted\x1b[2J")]}):
        with pytest.raises(PeerFault, match="cannot be read"):
            report(ADDRESSES[0], arc(0, 1), **forged)


@pytest.mark.parametrize("nonsense", [5, None, "repair", ["repair"], {"paused": 5, "records": "x"}])
def test_nonsense_in_a_report_of_upkeep_or_of_what_is_kept_apart_is_a_fault_of_the_node(nonsense: Any) -> None:
    said = report(ADDRESSES[0], arc(0, 1), upkeep={"paused": ["repair"]}, suspects={"records": 2})
    assert (said.paused, said.kept_apart.records) == (("repair",), 2)
    for key in ("upkeep", "suspects"):
        with pytest.raises(PeerFault, match="cannot be read"):
            report(ADDRESSES[0], arc(0, 1), **{key: nonsense})


@pytest.mark.parametrize(
    ("voters", "away", "late", "told", "degrades"),
    [
        (1, 0, 0, [], False),
        (3, 0, 0, [], False),
        (2, 0, 0, ["an even number"], False),
        (3, 1, 0, ["none more may be lost"], False),
        (3, 2, 0, ["nothing can be decided"], True),
        (4, 1, 0, ["an even number", "none more may be lost"], False),
        (1, 0, 1, [], False),
        (3, 0, 1, ["127.0.0.2, new among those who decide the cluster's log, does not grant leases yet"], False),
        (3, 1, 1, ["127.0.0.3, new among", "none more may be lost"], False),
    ],
)
def test_of_several_who_decide_the_log_it_is_told_what_their_number_and_silence_mean(
    voters: int, away: int, late: int, told: list[str], degrades: bool
) -> None:
    nodes = [
        replace(
            missing(f"127.0.0.{number + 2}", None)
            if number < away
            else node(f"127.0.0.{number + 2}", None, grants_leases=number >= away + late),
            is_voter=number < voters,
        )
        for number in range(5)
    ]
    concerns = list(voter_warnings(nodes))
    assert len(concerns) == len(told) and all(words in concern.text for words, concern in zip(told, concerns, strict=True))
    assert any(concern.degrades for concern in concerns) is degrades
