"""The trees of digests held against the records, and against themselves (specs/21-verify.md; 10-store.md, Digests).

A bucket in which a header has rotted may count that record still, or not any more: it is passed over.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from functools import partial
from itertools import pairwise

from scenefold.base.location import LAST
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.tables import EVERY_KEY, Sound, is_sound
from scenefold.store.digest_changes import built_to, unbuild
from scenefold.store.digest_tree import LEVELS, Row, Rows, TreeDamaged
from scenefold.store.homes import by_home
from scenefold.store.layout import DIGESTS, SPACE_BYTES, SpaceAddress, space_key, space_of
from scenefold.store.versions import stored_sum
from scenefold.world.ports import ReadTransaction

_END = bytes(LAST)
_UNBUILT_BYTES = 4
_BUCKETS = 1


def check_trees(raw: ReadTransaction, spaces: Collection[SpaceAddress], passed_over: Collection[SpaceAddress]) -> Iterator[Finding]:
    """What is wrong with the tree of each of the spaces that have records; those of the others count as well. `passed_over`: spaces in which
    it is not known where all objects lie."""
    rotten, met = set[SpaceAddress](), set(spaces)
    for key, stored in raw.scan(DIGESTS, *EVERY_KEY):
        if len(key) < SPACE_BYTES:
            continue
        space = space_of(key[_UNBUILT_BYTES:] if len(key) == _UNBUILT_BYTES + SPACE_BYTES else key)
        met.add(space)
        if not is_sound(DIGESTS, key, stored):
            rotten.add(space)
    for space in sorted(met):
        wrong = "a row of the digests has changed on the disk" if space in rotten else None
        if wrong is None and space not in passed_over:
            wrong = _wrong(Sound(raw), space)
        if wrong is not None:
            yield Finding(DIGESTS, named(DIGESTS, space_key(*space)), wrong, Helps.MEND, partial(unbuild, space=space))


def _wrong(sound: ReadTransaction, space: SpaceAddress) -> str | None:
    try:
        built = built_to(sound, space)
        rows = Rows(sound, space)
        levels = [dict(rows.behind(level, b"", _END)) for level in range(_BUCKETS, LEVELS + 1)]
    except TreeDamaged as damage:
        return str(damage)
    if any(_END not in level for level in levels):
        return "the digests do not reach to the end of the line"
    return _wrong_levels(levels) or _wrong_buckets(sound, space, built, levels[0])


def _wrong_levels(levels: list[dict[bytes, Row]]) -> str | None:
    for below, level in pairwise(levels):
        if not level.keys() <= below.keys():
            return "a bound of the digests is none of the level below"
        total = Row()
        for bound, row in below.items():
            total = total.plus(1, row.records, row.sum)
            if bound in level:
                if total != level[bound]:
                    return "a row of the digests is not the sum of those below it"
                total = Row()
    return None


def _wrong_buckets(sound: ReadTransaction, space: SpaceAddress, built: bytes, buckets: dict[bytes, Row]) -> str | None:
    """Buckets are in order, and so are records by their homes."""
    records = by_home(sound, space, b"", built) if built else iter(())
    found = next(records, None)
    for bound, row in buckets.items():
        total, is_known = Row(), True
        while found is not None and found.home <= bound:
            one = stored_sum(found.value)
            is_known = is_known and one is not None
            total = total.plus(1, 1, one or 0)
            found = next(records, None)
        if is_known and total != row:
            return "a row of the digests is not the sum of its records"
    return None
