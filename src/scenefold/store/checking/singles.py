"""Values that stand for themselves: who the node is, what it holds, what its services have noted (specs/21-verify.md)."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from scenefold.base.errors import LocalFault
from scenefold.base.ids import NodeId
from scenefold.store.checking.findings import Finding, Helps, named
from scenefold.store.checking.fixes import delete
from scenefold.store.checking.tables import EVERY_KEY, Sound, is_sound
from scenefold.store.holding import StoredHolding, read_holding
from scenefold.store.identity import FORMAT_VERSION, INCARNATION_BYTES, StoreIdentity
from scenefold.store.layout import HOLDING, IDENTITY, NOTES
from scenefold.store.sealing import StoreDamaged
from scenefold.world.ports import ReadTransaction

_NUMBER_BYTES = 4
_SIZES = {b"format": _NUMBER_BYTES, b"node": _NUMBER_BYTES, b"incarnation": INCARNATION_BYTES, b"boot": _NUMBER_BYTES}


def check_format(raw: ReadTransaction, where: str) -> None:
    """LocalFault if another program than this one knows what lies here."""
    stored = raw.get(IDENTITY, b"format")
    if stored is None or (len(stored) != _NUMBER_BYTES and not is_sound(IDENTITY, b"format", stored)):
        return
    # The first formats had no checksum behind the number.
    version = int.from_bytes(stored[:_NUMBER_BYTES], "big")
    if version > FORMAT_VERSION:
        what = f"the data folder was written by a newer scenefold (format {version}, this one knows {FORMAT_VERSION})"
        raise LocalFault(what, where=where, remedy="look at it with that one")
    if version < FORMAT_VERSION:
        what = f"the data folder was written by an earlier scenefold (format {version}, this one knows {FORMAT_VERSION})"
        raise LocalFault(
            what, where=where, remedy="start the node once, which brings its folder up to date, or says why not; then look again"
        )


def read_identity(raw: ReadTransaction) -> StoreIdentity | None:
    """Whose folder it is; None if that is damaged, or nobody's yet."""
    sound = Sound(raw)
    parts = {name: bytes(value) for name in _SIZES if (value := sound.get(IDENTITY, name)) is not None}
    if any(len(parts.get(name, b"")) != size for name, size in _SIZES.items()):
        return None
    return StoreIdentity(NodeId(int.from_bytes(parts[b"node"], "big")), parts[b"incarnation"], int.from_bytes(parts[b"boot"], "big"))


def check_values(raw: ReadTransaction, spare: Collection[str]) -> Iterator[Finding]:
    """The checksums. `spare`: notes that nobody needs."""
    for table in (IDENTITY, HOLDING, NOTES):
        for key, stored in raw.scan(table, *EVERY_KEY):
            if is_sound(table, key, stored):
                continue
            what = "a value has changed on the disk"
            if table == NOTES and key.decode(errors="replace") in spare:
                yield Finding(table, named(table, key), what, Helps.MEND, delete(table, key))
            else:
                yield Finding(table, named(table, key), what, Helps.WIPE)


def check_identity(raw: ReadTransaction, *, is_empty: bool) -> Iterator[Finding]:
    """Whether its parts are there, if all that are there are sound. A folder in which nothing lies need not have any."""
    keys = list(raw.keys(IDENTITY, *EVERY_KEY))
    if (not keys and is_empty) or any(Sound(raw).get(IDENTITY, key) is None for key in keys):
        return
    if read_identity(raw) is None:
        yield Finding(IDENTITY, IDENTITY, "the store's identity lacks a part, or one is none", Helps.WIPE)


def sound_holding(raw: ReadTransaction) -> StoredHolding | Finding | None:
    """What the node holds; what is wrong with that, if its values are sound and do not fit together; None if they are not sound, or not there."""
    sound = Sound(raw)
    if any(sound.get(HOLDING, key) is None for key in raw.keys(HOLDING, *EVERY_KEY)) or read_identity(raw) is None:
        return None
    try:
        return read_holding(sound)
    except StoreDamaged as damage:
        return Finding(HOLDING, HOLDING, damage.what, Helps.WIPE)
