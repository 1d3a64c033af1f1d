"""If this fails, `render watch` shows rates that are none, or breaks on a node that was lost and is back."""

from __future__ import annotations

import io
from dataclasses import replace

from rich.console import Console

from scenectl.render_nodes import TITLES, Moment, _screen, line_of, rows_of
from scenefold.render.reports import NodeStand, Stand


def moment(at: float, closed: int, *nodes: NodeStand, phase: str = "rendering") -> Moment:
    return Moment(at, Stand(phase, closed, 100, 0, bytes(32), 0, "", (), (), 0, {}), nodes)


FIRST = moment(10.0, 20, NodeStand("127.0.0.2", 300, 1_000, 10, 0, 1.0, 3 << 20), NodeStand("127.0.0.3", 100, 3_000, 0, 5, 2.0))
SECOND = moment(12.0, 30, NodeStand("127.0.0.2", 300, 5_000, 2_010, 1_234, 3.0, 5 << 20), NodeStand("127.0.0.3", 100, 5_000, 0, 5, 2.5))


def test_rates_are_of_what_came_between_two_looks() -> None:
    assert rows_of(FIRST, SECOND) == [
        ("127.0.0.2", "75%", "50%", "2,000", "1.00", "1,234", "5.0 MiB", "35.2 KiB"),
        ("127.0.0.3", "25%", "50%", "1,000", "0.25", "5", "", "0 B"),
    ]
    assert line_of(FIRST, SECOND) == "30 of 100 passes, 14 s left"


def test_who_is_back_and_who_is_new_count_from_nothing() -> None:
    back = moment(13.0, 30, NodeStand("127.0.0.2", 300, 10, 0, 0, 0.1), NodeStand("127.0.0.9", 0, 0, 0, 0, 0.0))
    assert [row[3] for row in rows_of(SECOND, back)] == ["0", "0"]
    assert line_of(SECOND, back) == "30 of 100 passes"
    assert line_of(SECOND, moment(14.0, 100, phase="merging")) == "merging"


def test_nobody_has_traced_anything() -> None:
    assert rows_of(*2 * (moment(1.0, 0, NodeStand("127.0.0.2", 0, 0, 0, 0, 0.0)),)) == [
        ("127.0.0.2", "0%", "0%", "0", "0.00", "0", "", "0 B")
    ]


def test_each_pool_has_all_of_the_scene() -> None:
    two = [look._replace(stand=replace(look.stand, document={"pools": 2})) for look in (FIRST, SECOND)]
    same = [look._replace(nodes=[replace(node, triangles=300) for node in look.nodes]) for look in two]
    assert [row[1] for row in rows_of(*same)] == ["100%", "100%"]
    assert [row[1] for row in rows_of(*two)] == ["150%", "50%"], "they hold some of it twice"
    for pools in (0, -1, 1.5, 2**70, "2", None):
        assert replace(FIRST.stand, document={"pools": pools}).pools == 1


def test_the_screen_has_all_of_it() -> None:
    console = Console(file=io.StringIO(), width=200)
    console.print(_screen(FIRST, SECOND))
    assert isinstance(console.file, io.StringIO)
    shown = console.file.getvalue()
    assert all(text in shown for text in (*TITLES, "127.0.0.3", "2,000", "14 s left"))
