"""The pages of an LMDB file (0.9 format), looked at without LMDB (specs/21-verify.md, Verify).

LMDB trusts its pages: met by one that has rotted it ends the process, or reads on behind its end, or does not find what is there. So
whoever wants to know what is left of a file must know first that its pages are pages: each where it says to be, of the kind that it should
be, with entries inside of it, in order, and between the bounds that the page above sets; each used once; none of them behind the end of
the file. What is in the values is others' to judge.
"""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from scenefold.base.errors import LocalFault
from scenefold.store.sealing import WIPE

TOLD_MAX = 20
"""One page that has rotted may spoil all that is below it."""
_MAGIC = 0xBEEFC0DE
_PAGE = struct.Struct("=QHHHH")
_OVERFLOW_PAGES = struct.Struct("=I")
_ENTRY = struct.Struct("=HHHH")
_NUMBER = struct.Struct("=Q")
_META = struct.Struct("=IIQQ48s48sQQ")
_TREE = struct.Struct("=IHHQQQQQ")
_BRANCH, _LEAF, _OVERFLOW = 1, 2, 4
_KINDS = _BRANCH | _LEAF | _OVERFLOW
_BIG, _NAMED = 1, 2
_NONE = (1 << 64) - 1
_PAGE_SIZES = tuple(1 << bits for bits in range(9, 17))
_DEPTH_MAX = 32
"""As LMDB's own."""


class PagesDamaged(LocalFault):
    """The tree cannot be trusted. `problems`: some of what is wrong with it."""

    def __init__(self, problems: list[str], where: str) -> None:
        super().__init__(f"the tree of the store is damaged: {problems[0]}", where=where, remedy=WIPE)
        self.problems = problems


class _Damage(Exception):
    """What is wrong with a page."""


class _Tree(NamedTuple):
    flags: int
    depth: int
    entries: int
    root: int


def check_pages(path: Path) -> None:
    """PagesDamaged if a page in use is not what it should be, or none says to be the first of a store. Some us an entry."""
    if not path.stat().st_size:
        raise PagesDamaged([f"{path.name} is empty"], str(path.parent))
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        metas = [found for found in (_meta(data, 0), *(_meta(data, size) for size in _PAGE_SIZES)) if found is not None]
        if not metas:
            what = f"{path.name} was written over or cut off, or is no store: nothing in it says where the tree begins"
            raise PagesDamaged([what], str(path.parent))
        problems = list(islice(_Pages(data, *max(metas, key=lambda meta: meta[-1])[:-1]).problems(), TOLD_MAX))
    if problems:
        raise PagesDamaged(problems, str(path.parent))


def _meta(data: mmap.mmap, at: int) -> tuple[int, _Tree, _Tree, int, int] | None:
    """Size of pages, the tree of free pages, that of the tables, the last page, and the transaction; None if there is no meta page."""
    if at + _PAGE.size + _META.size > len(data):
        return None
    magic, version, _, _, free, main, last, transaction = _META.unpack_from(data, at + _PAGE.size)
    size = _TREE.unpack(free)[0]
    if magic != _MAGIC or version != 1 or size not in _PAGE_SIZES or at not in (0, size):
        return None
    return size, _tree(free), _tree(main), last, transaction


def _tree(packed: bytes) -> _Tree:
    _, flags, depth, _, _, _, entries, root = _TREE.unpack(packed)
    return _Tree(flags, depth, entries, root)


class _Pages:
    """All pages of a file that a transaction uses, each met once."""

    def __init__(self, data: mmap.mmap, size: int, free: _Tree, main: _Tree, last: int) -> None:
        self._data = data
        self._size = size
        self._free = free
        self._main = main
        self._last = last
        self._wants_values = False
        self._used = bytearray(last + 1) if last < len(data) else bytearray()

    def problems(self) -> Iterator[str]:
        if not self._used:
            yield "it says that it has more pages than the file has bytes"
            return
        named: list[tuple[str, _Tree]] = []
        free: list[bytes] = []
        yield from self._walk("the tables", self._main, lambda key, value, flags: self._note(named, key, value, flags))
        for name, tree in named:
            yield from self._walk(name, tree, _pass_over)
        # Lists of free pages have pages of their own, which are read; those of records are not.
        self._wants_values = True
        yield from self._walk("free pages", self._free, lambda _key, value, _flags: free.append(value), is_numbered=True)
        for value in free:
            yield from self._check_free(value)

    @staticmethod
    def _note(named: list[tuple[str, _Tree]], key: bytes, value: bytes, flags: int) -> None:
        if not flags & _NAMED or len(value) != _TREE.size:
            raise _Damage("a table's entry is none")
        named.append((key.decode(errors="replace"), _tree(value)))

    def _check_free(self, value: bytes) -> Iterator[str]:
        """A page that is free and in use would be written over."""
        (count,) = _NUMBER.unpack_from(value) if len(value) >= _NUMBER.size else (_NONE,)
        if (count + 1) * _NUMBER.size > len(value):
            yield "a list of free pages is none"
            return
        for (page,) in _NUMBER.iter_unpack(value[_NUMBER.size : (count + 1) * _NUMBER.size]):
            if page > self._last or self._used[page]:
                yield f"page {page} is said to be free, and is in use, or none"

    # -------------------------------------------------------------------------------------------------------- walking

    def _walk(self, name: str, tree: _Tree, take: Callable[[bytes, bytes, int], None], *, is_numbered: bool = False) -> Iterator[str]:
        """What is wrong with a tree; `take` hears of its entries."""
        if tree.root == _NONE:
            return
        if not 0 < tree.depth <= _DEPTH_MAX:
            yield f"{name}: a tree of {tree.depth} levels"
            return
        met = 0

        def count(key: bytes, value: bytes, flags: int) -> None:
            nonlocal met
            met += 1
            take(key, value, flags)

        is_whole = True
        for problem in self._descend(tree.root, tree.depth, None, None, count, is_numbered):
            is_whole = False
            yield f"{name}: {problem}"
        if is_whole and met != tree.entries:
            yield f"{name}: {met} entries, where {tree.entries} are counted"

    def _descend(
        self, page: int, depth: int, low: bytes | None, high: bytes | None, take: Callable[[bytes, bytes, int], None], is_numbered: bool
    ) -> Iterator[str]:
        try:
            entries = list(self._entries(page, depth, low, high, is_numbered))
            if depth == 1:
                for key, value, flags in entries:
                    take(key, value, flags)
                return
        except _Damage as damage:
            yield f"page {page}: {damage}"
            return
        for index, (key, value, _) in enumerate(entries):
            following = entries[index + 1][0] if index + 1 < len(entries) else high
            yield from self._descend(_NUMBER.unpack(value)[0], depth - 1, key if index else low, following, take, is_numbered)

    def _entries(
        self, page: int, depth: int, low: bytes | None, high: bytes | None, is_numbered: bool
    ) -> Iterator[tuple[bytes, bytes, int]]:
        """Keys with their values, of a branch the pages below. _Damage if they are not what they should be."""
        begin = self._use(page, 1)
        number, _, flags, lower, upper = _PAGE.unpack_from(self._data, begin)
        kind = _LEAF if depth == 1 else _BRANCH
        if number != page or flags & _KINDS != kind:
            raise _Damage("it says to be another one")
        if not _PAGE.size <= lower <= upper <= self._size or lower % 2:
            raise _Damage("its bounds are none")
        pointers = struct.unpack_from(f"={(lower - _PAGE.size) // 2}H", self._data, begin + _PAGE.size)
        if not pointers or (kind == _BRANCH and len(pointers) < 2):
            raise _Damage("it has too few entries")
        before = low
        for index, pointer in enumerate(pointers):
            if not upper <= pointer <= self._size - _ENTRY.size:
                raise _Damage("an entry lies outside of it")
            key, value, entry_flags = self._entry(begin, pointer, kind)
            if kind == _BRANCH and index == 0:
                # Whatever is below the second key.
                yield b"", value, 0
                continue
            if not _are_in_order(before, key, is_numbered, may_be_same=index == 0) or (
                high is not None and not _is_below(key, high, is_numbered)
            ):
                raise _Damage("its keys are not in order")
            before = key
            yield key, value, entry_flags

    def _entry(self, begin: int, pointer: int, kind: int) -> tuple[bytes, bytes, int]:
        low, high, flags, key_size = _ENTRY.unpack_from(self._data, begin + pointer)
        at = pointer + _ENTRY.size
        if at + key_size > self._size:
            raise _Damage("a key goes on behind its end")
        key = self._data[begin + at : begin + at + key_size]
        at += key_size
        if kind == _BRANCH:
            return key, _NUMBER.pack(low | high << 16 | flags << 32), 0
        size = low | high << 16
        is_big = flags & _BIG
        if at + (_NUMBER.size if is_big else size) > self._size:
            raise _Damage("a value goes on behind its end")
        if not is_big:
            return key, self._data[begin + at : begin + at + size], flags
        return key, self._big(_NUMBER.unpack_from(self._data, begin + at)[0], size), flags

    def _big(self, page: int, size: int) -> bytes:
        """Where a value has pages of its own."""
        pages = (_PAGE.size - 1 + size) // self._size + 1
        begin = self._use(page, pages)
        number, _, flags, *_ = _PAGE.unpack_from(self._data, begin)
        (counted,) = _OVERFLOW_PAGES.unpack_from(self._data, begin + _PAGE.size - _OVERFLOW_PAGES.size)
        if number != page or flags & _KINDS != _OVERFLOW or counted != pages:
            raise _Damage(f"a value's own page, {page}, says to be another one")
        return self._data[begin + _PAGE.size : begin + _PAGE.size + size] if self._wants_values else b""

    def _use(self, page: int, count: int) -> int:
        """Where pages begin; they must be there, and nobody else's."""
        if not 2 <= page <= self._last or page + count - 1 > self._last:
            raise _Damage(f"page {page} is none")
        if (page + count) * self._size > len(self._data):
            raise _Damage(f"page {page} lies behind the end of the file, which is cut off")
        if any(self._used[page : page + count]):
            raise _Damage(f"page {page} is used twice")
        self._used[page : page + count] = b"\1" * count
        return page * self._size


def _pass_over(_key: bytes, _value: bytes, _flags: int) -> None:
    """For who wants to know only that it is there."""


def _are_in_order(before: bytes | None, key: bytes, is_numbered: bool, *, may_be_same: bool) -> bool:
    return before is None or (may_be_same and before == key) or _is_below(before, key, is_numbered)


def _is_below(one: bytes, other: bytes, is_numbered: bool) -> bool:
    if not is_numbered:
        return one < other
    return len(one) == len(other) == _NUMBER.size and _NUMBER.unpack(one) < _NUMBER.unpack(other)
