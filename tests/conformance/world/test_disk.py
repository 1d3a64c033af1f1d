"""If this failed, a store in one world would find other data than the same store in the other."""

from __future__ import annotations

import threading
from collections.abc import Callable
from pathlib import Path
from random import Random
from typing import Any

import pytest

from conformance.world.makers import Worlds
from scenefold.base.errors import LocalFault
from scenefold.world import DiskFailed, Environment

TABLES = ("a", "b")


def rows(environment: Environment, table: str, first: bytes = b"", last: bytes = b"\xff") -> list[tuple[bytes, bytes]]:
    with environment.read() as transaction:
        found = [(key, bytes(value)) for key, value in transaction.scan(table, first, last)]
        assert [key for key, _ in found] == list(transaction.keys(table, first, last))
        assert transaction.first(table, first, last) == (found[0] if found else None)
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


def backwards(environment: Environment, table: str, first: bytes, last: bytes) -> list[bytes]:
    with environment.read() as transaction:
        found = [(key, bytes(value)) for key, value in transaction.scan(table, first, last, reverse=True)]
        assert [key for key, _ in found] == list(transaction.keys(table, first, last, reverse=True))
    assert found == rows(environment, table, first, last)[::-1]
    return [key for key, _ in found]


def test_walks_go_backwards(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    assert backwards(environment, "a", b"", b"\xff") == []
    environment.update(lambda transaction: [transaction.put("a", key, key) for key in (b"b", b"d", b"dd", b"f")])
    assert backwards(environment, "a", b"", b"\xff") == [b"f", b"dd", b"d", b"b"]
    assert backwards(environment, "a", b"b", b"d") == [b"d", b"b"]
    assert backwards(environment, "a", b"c", b"e") == [b"dd", b"d"]
    assert backwards(environment, "a", b"a", b"c") == [b"b"]
    assert backwards(environment, "a", b"g", b"h") == []
    assert backwards(environment, "a", b"", b"a") == []
    assert backwards(environment, "a", b"e", b"e") == []
    assert backwards(environment, "b", b"", b"\xff") == []
    environment.close()


@pytest.mark.parametrize("reverse", [False, True])
def test_a_walk_may_delete_what_it_meets(worlds: Worlds, tmp_path: Path, reverse: bool) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)

    def thin_out(transaction: Any) -> list[bytes]:
        seen = []
        for key in transaction.keys("a", b"02", b"07", reverse=reverse):
            seen.append(key)
            if int(key) % 2:
                assert transaction.delete("a", key)
        return seen

    environment.update(lambda transaction: [transaction.put("a", b"%02d" % number, b"x") for number in range(10)])
    seen = environment.update(thin_out)
    assert seen == sorted(seen, reverse=reverse) == [b"%02d" % number for number in (range(7, 1, -1) if reverse else range(2, 8))]
    assert [int(key) for key, _ in rows(environment, "a")] == [0, 1, 2, 4, 6, 8, 9]
    environment.close()


def test_a_change_sees_itself(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    environment.update(lambda transaction: [transaction.put("a", key, b"old") for key in (b"a", b"c", b"e")])

    def change(transaction: Any) -> None:
        transaction.put("a", b"b", b"new")
        transaction.put("a", b"c", b"new")
        transaction.delete("a", b"e")
        for reverse in (False, True):
            found = [(key, bytes(value)) for key, value in transaction.scan("a", b"", b"\xff", reverse=reverse)]
            assert sorted(found) == [(b"a", b"old"), (b"b", b"new"), (b"c", b"new")]
            assert found == sorted(found, reverse=reverse)
        assert transaction.get("a", b"e") is None
        transaction.put("a", b"e", b"again")
        assert list(transaction.keys("a", b"d", b"z")) == [b"e"]

    environment.update(change)
    assert [bytes(value) for _, value in rows(environment, "a")] == [b"old", b"new", b"new", b"again"]
    environment.close()


def test_any_changes_leave_what_a_plain_dict_has(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    dice, model = Random(1), dict[bytes, bytes]()

    def change(transaction: Any) -> None:
        for _ in range(dice.randrange(10)):
            key = b"%d" % dice.randrange(40)
            if dice.random() < 0.4:
                assert transaction.delete("a", key) == (model.pop(key, None) is not None)
            else:
                model[key] = dice.randbytes(dice.randrange(1, 2000))
                transaction.put("a", key, model[key])
            first, last = sorted((b"%d" % dice.randrange(100), b"%d" % dice.randrange(100)))
            reverse = dice.random() < 0.5
            expected = sorted((key for key in model if first <= key <= last), reverse=reverse)
            assert list(transaction.keys("a", first, last, reverse=reverse)) == expected

    for _ in range(60):
        before = dict(model)
        if dice.random() < 0.2:
            with pytest.raises(KeyError):
                environment.update(_failing(change))
            model.clear()
            model.update(before)
        else:
            environment.update(change)
        assert dict(rows(environment, "a")) == model
    environment.close()


def _failing(change: Callable[[Any], None]) -> Callable[[Any], None]:
    def fail(transaction: Any) -> None:
        change(transaction)
        raise KeyError("on second thoughts")

    return fail


def test_space_is_counted_and_reused(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    empty = environment.space()
    assert 0 < empty.free <= empty.total
    environment.update(lambda transaction: [transaction.put("a", b"%d" % number, bytes(10_000)) for number in range(50)])
    full = environment.space()
    assert full.used >= empty.used + 500_000
    environment.update(lambda transaction: [transaction.delete("a", b"%d" % number) for number in range(50)])
    after = environment.space()
    assert after.used < 100_000
    assert after.reusable >= 400_000
    environment.close()


def test_a_closed_folder_takes_no_more(worlds: Worlds, tmp_path: Path) -> None:
    environment = worlds.node(0).disk.open(tmp_path, TABLES)
    environment.close()
    with pytest.raises(DiskFailed, match="closed"):
        environment.update(lambda transaction: transaction.put("a", b"key", b"value"))
