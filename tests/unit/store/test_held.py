"""If this failed, who recovers a part of the line would not hear of a record that lies there, and take it for never acknowledged."""

from __future__ import annotations

from pathlib import Path

from scenefold.base.limits import HELD_CURSOR_BYTES_MAX
from scenefold.base.location import WHOLE_LINE, Arc, Location
from scenefold.crypto import wanted_place
from scenefold.store import Put, Store, version_of
from scenefold.store.held import CURSOR_BYTES_MAX
from unit.store.samples import arc, managed, object_id, put, record, whole_store, world

HOME = wanted_place(object_id(1)).number


async def listed(store: Store, where: Arc, limit: int) -> list[tuple[int, int, bytes]]:
    """(space, home, object) of all, page by page."""
    found, after = [], b""
    while True:
        page = await store.held(where, after, limit)
        assert len(page.records) <= limit
        found += [(held.spot.place.space, held.home.number, held.spot.object) for held in page.records]
        assert all(version_of(held.header) == held.version for held in page.records)
        if page.cursor is None:
            return found
        assert after < page.cursor and len(page.cursor) <= CURSOR_BYTES_MAX <= HELD_CURSOR_BYTES_MAX
        after = page.cursor


async def test_everything_with_its_home_there_is_listed_in_order_and_once(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.put_holding(None, b"")
        fixed = [put(number, space=space) for space in (3, 2) for number in (0, 10, HOME, HOME + 5)]
        # An object is listed where its home is, wherever it lies.
        await store.merge([*fixed, Put(managed(1), at=Location.from_number(7))])
        name = object_id(1)
        everything = [(2, 0, b""), (2, 10, b""), (2, HOME, name), (2, HOME, b""), (2, HOME + 5, b"")]
        everything += [(3, number, b"") for number in (0, 10, HOME, HOME + 5)]
        for limit in (1, 2, 3, 9, 100):
            assert await listed(store, WHOLE_LINE, limit) == everything
            assert await listed(store, arc(HOME, HOME), limit) == [(2, HOME, name), (2, HOME, b""), (3, HOME, b"")]
            assert await listed(store, arc(1, 9), limit) == []
        assert record(0).header.space == 2


async def test_any_cursor_is_one(tmp_path: Path) -> None:
    async with whole_store(world(), tmp_path) as store:
        await store.merge([put(number) for number in (0, 10, 20)])
        for after in (
            b"\0",
            b"\0\0\0\7\0\2",
            b"\0\0\0\7\0\2\0",
            b"\0\0\0\7\0\2" + bytes(19) + b"\5",
            b"\0\0\0\7\0\2" + b"\xff" * 20,
            b"\xff" * 64,
        ):
            page = await store.held(WHOLE_LINE, after, 9)
            expected = [0, 10, 20] if after < b"\0\0\0\7\0\2" + bytes(20) else [10, 20] if after[-1] == 5 else []
            assert [held.home.number for held in page.records] == expected
