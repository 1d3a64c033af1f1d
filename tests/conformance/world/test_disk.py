"""If this failed, a store in one world would find other data than the same store in the other."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest

from conformance.world.makers import Worlds
from scenefold.base.errors import LocalFault
from scenefold.world import Environment

TABLES = ("a", "b")


def rows(environment: Environment, table: str, first: bytes = b"", last: bytes = b"\xff") -> list[tuple[bytes, bytes]]:
    with environment.read() as transaction:
        found = [(key, bytes(value)) for key, value in transaction.scan(table, first, last)]
        assert [key for key, _ in found] == list(transaction.keys(table, first, last))
        return found


def test_changes_stay_and_are_ordered_by_their_keys(worlds: Worlds, tmp_path: Path) -> None:
    disk = worlds.node(0).disk
    environment = disk.open(tmp_path, TABLES)

    def fill(transaction: Any) -> str:
        for key in (b"c", b"a", b"bb", b"b"):
            transaction.put("a", key, key * 3)
        transaction.put("b", b"c", b"other table")
        assert bytes(transaction.get("a", b"c")) == b"ccc"
        assert transaction.delete("a", b"c")
        assert not transaction.delete("a", b"c")
        return "result"

    assert environment.update(fill) == "result"
    environment.close()
    environment = disk.open(tmp_path, TABLES)
    assert rows(environment, "a") == [(b"a", b"aaa"), (b"b", b"bbb"), (b"bb", b"bbbbbb")]
    assert rows(environment, "a", b"ab", b"b") == [(b"b", b"bbb")]
    assert rows(environment, "a", b"c", b"d") == []
    with environment.read() as transaction:
        assert transaction.get("b", b"a") is None
        value = transaction.get("b", b"c")
        assert value is not None
        assert bytes(value) == b"other table"
    environment.close()


def test_a_change_that_raises_leaves_nothing(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)

    def half(transaction: Any) -> None:
        transaction.put("a", b"key", b"value")
        raise KeyError("no")

    with pytest.raises(KeyError):
        environment.update(half)
    assert rows(environment, "a") == []
    environment.close()


def test_a_reader_sees_one_moment(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    environment.update(lambda transaction: transaction.put("a", b"key", b"old"))
    view_open, written = threading.Event(), threading.Event()
    seen = []

    def read() -> None:
        with environment.read() as transaction:
            view_open.set()
            assert written.wait(30)
            value = transaction.get("a", b"key")
            seen.append(bytes(value or b""))

    reader = threading.Thread(target=read)
    reader.start()
    assert view_open.wait(30)
    environment.update(lambda transaction: transaction.put("a", b"key", b"new"))
    written.set()
    reader.join()
    assert seen == [b"old"]
    assert rows(environment, "a") == [(b"key", b"new")]
    environment.close()


def test_more_than_the_first_map_holds(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    runs = 0

    def fill(transaction: Any) -> None:
        nonlocal runs
        runs += 1
        for number in range(100):
            transaction.put("a", b"%03d" % number, bytes(60_000))

    environment.update(fill)
    assert runs >= 1
    assert len(rows(environment, "a")) == 100
    space = environment.space()
    assert space.used > 6_000_000
    environment.close()


def test_a_folder_is_open_once(worlds: Worlds, tmp_path: Path) -> None:
    disk = worlds.node(0).disk
    environment = disk.open(tmp_path, TABLES)
    with pytest.raises(LocalFault, match="in use"):
        disk.open(tmp_path, TABLES)
    environment.close()
    disk.open(tmp_path, TABLES).close()
