"""What is kept apart, read as it would be read for who holds its scene's key (specs/21-verify.md)."""

from __future__ import annotations

from collections.abc import Iterator

from scenefold.base.errors import DamagedData
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.fixes import delete
from scenefold.store.checking.records import OBJECT_KEY_BYTES, PLACE_KEY_BYTES
from scenefold.store.checking.tables import EVERY_KEY
from scenefold.store.layout import SUSPECTS, unpack_record
from scenefold.world.ports import ReadTransaction


def check_suspects(raw: ReadTransaction) -> Iterator[Finding]:
    """What has rotted nobody can be shown: it goes."""
    for key, value in raw.scan(SUSPECTS, *EVERY_KEY):
        if len(key) not in (PLACE_KEY_BYTES, OBJECT_KEY_BYTES):
            what = "a record under a key that names no place"
            yield Finding(SUSPECTS, f"{SUSPECTS}, {key.hex()}", what, Helps.MEND, delete(SUSPECTS, key))
            continue
        try:
            unpack_record(value)
        except DamagedData as damage:
            yield Finding(SUSPECTS, named(SUSPECTS, key), damage.what, Helps.MEND, delete(SUSPECTS, key))
