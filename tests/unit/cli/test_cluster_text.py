"""If this fails, `cluster status`, `nodes` or `top` break on a node that says nothing, or hide what is off."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from scenectl.cluster_text import movement_text, nodes_text, removed_text, seconds_text, status_text
from scenectl.top import _lines, _screen
from scenefold.base.location import WHOLE_LINE
from scenefold.client import ClusterStatus, Movement, NodeState, rates
from scenefold.client.health import judged
from scenefold.client.removals import RemovedNode
from unit.client.test_health import report

SILENT = NodeState("127.0.0.2", bytes([7]) * 16, True, WHOLE_LINE, 75.0, None, "connection refused")
STRANGER = NodeState("127.0.0.3", bytes(16), False, None, None, None, "timed out")
MOVEMENT = Movement("0a", "127.0.0.2", "127.0.0.3", "offered", WHOLE_LINE, 1_000, 250, 3.0)


def test_silent_nodes_have_their_line() -> None:
    found = judged("studio", "127.0.0.4", [SILENT, STRANGER])
    text = status_text(found)
    assert text.splitlines()[0] == "studio: 0 of 2 nodes alive, as 127.0.0.4 knows it"
    assert "warning: 127.0.0.2 does not answer; nobody can join or be removed meanwhile: connection refused" in text
    assert "awaited" in text and "nothing" in text and "1 min" in text and "never" in text
    assert "07070707" in nodes_text(found)


def test_top_shows_what_moves_on_lines_and_on_a_screen() -> None:
    found = judged("studio", "127.0.0.4", [SILENT, STRANGER])
    changed = rates([], found.nodes, 1.0)
    lines = _lines(found, changed, [MOVEMENT])
    console = Console(file=io.StringIO(), width=200)
    console.print(_screen(found, changed, [MOVEMENT]))
    assert isinstance(console.file, io.StringIO)
    for text in (lines, console.file.getvalue()):
        assert movement_text(MOVEMENT) in text
        assert "missing" in text and "warning: 127.0.0.3 has never come" in text


def test_of_a_silent_node_top_shows_what_it_said_last() -> None:
    silent = replace(SILENT, last=report(SILENT.address, WHOLE_LINE, records=1_234), last_s=12.3)
    found = judged("studio", "127.0.0.4", [silent])
    lines = _lines(found, rates([], found.nodes, 1.0), [])
    assert "silent 12.3 s" in lines and "1,234 records" in lines


def test_what_was_turned_away_is_shown_where_there_is_any() -> None:
    def found(*counts: tuple[int, int]) -> ClusterStatus:
        events = [{"connections turned away": away, "datagrams dropped": dropped} for away, dropped in counts]
        nodes = [replace(SILENT, report=report(SILENT.address, WHOLE_LINE, events=one)) for one in events]
        return judged("studio", "127.0.0.4", nodes)

    some = found((1_000, 2), (5, 0))
    console = Console(file=io.StringIO(), width=200)
    console.print(_screen(some, rates([], some.nodes, 1.0), []))
    assert isinstance(console.file, io.StringIO)
    for text in (status_text(some), _lines(some, rates([], some.nodes, 1.0), []), console.file.getvalue()):
        assert "turned away since the nodes started: 1,005 connections, 2 datagrams" in text
    assert "turned away since the nodes started: 1 connection, 0 datagrams" in status_text(found((1, 0)))
    assert "turned away" not in status_text(found((0, 0)))
    assert [(one.document()["connections_turned_away"], one.document()["datagrams_dropped"]) for one in some.nodes] == [(1_000, 2), (5, 0)]
    assert SILENT.document()["connections_turned_away"] is None


def test_blacklists_are_shown_where_there_are_any() -> None:
    found = judged("studio", "127.0.0.4", [replace(SILENT, blacklist=("127.0.0.3", "127.0.0.9")), STRANGER])
    for text in (status_text(found), nodes_text(found)):
        assert "127.0.0.2 wants no copies of its data on 127.0.0.3, 127.0.0.9" in text
        assert text.count("wants no copies") == 1


def test_who_was_removed_is_told_with_the_reason_and_the_oldest_are_counted() -> None:
    gone = tuple(
        RemovedNode(f"127.0.0.{9 + number}", bytes([number]) * 16, 40 - number, "not heard for 124 s", "127.0.0.2", number == 7)
        for number in range(8)
    )
    found = replace(judged("studio", "127.0.0.4", [SILENT, STRANGER]), removed=gone[:7])
    text = status_text(found)
    assert "127.0.0.9 is no member any more: not heard for 124 s (position 40)" in text
    assert "127.0.0.14" not in text and "and 2 more: scenectl cluster nodes --removed" in text
    assert found.document()["removed"][0]["address"] == "127.0.0.9"
    rows = removed_text(gone).splitlines()
    assert len(rows) == 9 and rows[1].split()[:5] == ["127.0.0.9", "40", "127.0.0.2", "00000000", "gone"]
    assert " back " in rows[-1] and removed_text(()) == "No node was ever removed."


def test_a_movement_says_how_far_it_is() -> None:
    assert movement_text(MOVEMENT) == "127.0.0.2 -> 127.0.0.3  00000000..ffffffff  25%, 250 of 1,000 records, for 3 s"
    assert seconds_text(3.21) == "3.2 s"
