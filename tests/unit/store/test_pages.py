"""If this failed, who looks at a damaged file would be ended by LMDB, or be told that all is well where it does not find what is there."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import lmdb
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scenefold.store import LmdbDisk
from scenefold.store.lmdb_disk import DATA_NAME
from scenefold.store.lmdb_pages import PagesDamaged, check_pages

TABLES = ("a", "b", "empty")
PAGE = 4096
BIG = 12


def written(folder: Path, seed: int = 1) -> Path:
    """A file with trees of several levels, values with pages of their own, and free pages."""
    dice = random.Random(seed)
    environment = LmdbDisk(map_bytes_first=1 << 24).open(folder, TABLES)

    def change(transaction: Any) -> None:
        for number in dice.sample(range(900), 300):
            transaction.put("a", b"%05d" % number * 20, dice.randbytes(dice.randrange(400)))
        for number in dice.sample(range(900), 100):
            transaction.delete("a", b"%05d" % number * 20)

    for _ in range(5):
        environment.update(change)
    environment.update(lambda transaction: [transaction.put("b", b"%d" % number, bytes(60_000)) for number in range(BIG + 5)])
    environment.update(lambda transaction: [transaction.delete("b", b"%d" % number) for number in range(BIG, BIG + 5)])
    environment.close()
    return folder / DATA_NAME


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    data = written(tmp_path_factory.mktemp("sound")).read_bytes()
    # Without the room behind the last page.
    return data[: -(-len(data.rstrip(b"\0")) // PAGE) * PAGE]


def problems(folder: Path, data: bytes) -> list[str]:
    (folder / DATA_NAME).write_bytes(data)
    try:
        check_pages(folder / DATA_NAME)
    except PagesDamaged as damage:
        return damage.problems
    return []


@pytest.mark.parametrize("seed", range(4))
def test_a_file_in_which_all_is_well(tmp_path: Path, seed: int) -> None:
    check_pages(written(tmp_path, seed))


def test_a_new_file(tmp_path: Path) -> None:
    LmdbDisk().open(tmp_path, TABLES).close()
    check_pages(tmp_path / DATA_NAME)


@pytest.mark.parametrize("data", [b"", b"a picture, perhaps" * 1000, bytes(100_000)])
def test_what_is_no_file_of_lmdb_is_damage(tmp_path: Path, data: bytes) -> None:
    (problem,) = problems(tmp_path, data)
    assert problem.startswith(f"{DATA_NAME} ") and ("no store" in problem if data else "empty" in problem)


def in_use(folder: Path, data: bytes) -> int:
    """How many pages hold entries, by LMDB's own count, and how many begin a value."""
    (folder / DATA_NAME).write_bytes(data)
    with lmdb.open(str(folder), readonly=True, lock=False, max_dbs=9) as env, env.begin() as transaction:
        stats = [env.stat(), *(transaction.stat(env.open_db(name.encode(), txn=transaction, create=False)) for name in TABLES)]
    assert max(stat["depth"] for stat in stats) >= 3
    return sum(stat["branch_pages"] + stat["leaf_pages"] for stat in stats) + BIG


@pytest.mark.parametrize("how", ["zeros", "noise", "another page"])
def test_each_page_that_is_in_use_is_looked_at(tmp_path: Path, sound: bytes, how: str) -> None:
    dice, found = random.Random(how), 0
    pages = len(sound) // PAGE
    for page in range(2, pages):
        other = {"zeros": bytes(PAGE), "noise": dice.randbytes(PAGE), "another page": sound[(page - 1) * PAGE : page * PAGE]}[how]
        found += bool(problems(tmp_path, sound[: page * PAGE] + other + sound[(page + 1) * PAGE :]))
    # Those with free pages, which LMDB does not count here, are one or more besides.
    assert in_use(tmp_path, sound) < found < pages - 2


def test_a_file_that_is_cut_off(tmp_path: Path, sound: bytes) -> None:
    assert problems(tmp_path, sound) == []
    assert "cut off" in " ".join(problems(tmp_path, sound[: len(sound) // 3]))
    with pytest.raises(PagesDamaged, match="cut off") as damage:
        check_pages(tmp_path / DATA_NAME)
    assert damage.value.where == str(tmp_path) and "wipe the folder" in damage.value.remedy
    assert problems(tmp_path, sound[: 2 * PAGE])


def leaves(data: bytes) -> Iterator[int]:
    """Where pages with entries of the first table begin."""
    for at in range(2 * PAGE, len(data), PAGE):
        if int.from_bytes(data[at + 10 : at + 12], "little") == 2 and b"000" in data[at + 100 : at + PAGE]:
            yield at


def test_keys_out_of_order_and_entries_outside(tmp_path: Path, sound: bytes) -> None:
    """LMDB would not find what is there: a walk meets it, a look does not."""
    told = set[str]()
    for at in leaves(sound):
        first, second = sound[at + 16 : at + 18], sound[at + 18 : at + 20]
        swapped = sound[: at + 16] + second + first + sound[at + 20 :]
        outside = sound[: at + 16] + b"\xfe\xff" + sound[at + 18 :]
        told |= {problem.partition(": ")[2].partition(": ")[2] for data in (swapped, outside) for problem in problems(tmp_path, data)}
    assert {"its keys are not in order", "an entry lies outside of it"} <= told


@settings(max_examples=60)
@given(flips=st.lists(st.integers(0, 8 * 300 * PAGE), min_size=1, max_size=8))
def test_whatever_turns_over_ends_in_words(sound: bytes, tmp_path_factory: pytest.TempPathFactory, flips: list[int]) -> None:
    data = bytearray(sound)
    for bit in flips:
        data[bit // 8 % len(data)] ^= 1 << bit % 8
    problems(tmp_path_factory.getbasetemp(), bytes(data))
