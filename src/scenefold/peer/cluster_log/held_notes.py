"""What a voter keeps for leases, as notes (specs/26-modes.md, Lives, with a majority).

Lives stand in 256 pages, by the first byte of their incarnations, so that one more writes a few others anew and not all of them; and
incarnations that are over go with the next change of their page. A change is one transaction, whatever pages it touches.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Mapping

from scenefold.base.errors import DamagedData
from scenefold.base.ids import NodeId
from scenefold.peer.cluster_log.lease_grants import Held
from scenefold.peer.cluster_log.lives import note_of, unpack_granted
from scenefold.peer.cluster_log.numbered_lives import FIRST_NUMBER, Life, merged
from scenefold.store import Store

READY = "cluster-log/ready"
_POSITION = struct.Struct(">Q")
_ROW = struct.Struct(">16sQQ")


def page_of(first: int) -> str:
    """Where the lives of incarnations stand that begin with this byte."""
    return f"cluster-log/held/{first:02x}"


def pack_page(lives: Mapping[bytes, Life]) -> bytes:
    return b"".join(_ROW.pack(incarnation, *life) for incarnation, life in sorted(lives.items()))


def unpack_page(data: bytes) -> dict[bytes, Life]:
    """DamagedData if this is not what was packed."""
    if len(data) % _ROW.size:
        raise DamagedData("a page of lives that this node has granted is damaged")
    rows = [(incarnation, Life(number, mark)) for incarnation, number, mark in _ROW.iter_unpack(data)]
    names = [incarnation for incarnation, _ in rows]
    if names != sorted(set(names)):
        raise DamagedData("a page of lives that this node has granted is damaged")
    return dict(rows)


def unpack_ready(data: bytes) -> int:
    """Likewise."""
    if len(data) != _POSITION.size:
        raise DamagedData("since when this node grants leases cannot be read")
    return int(_POSITION.unpack(data)[0])


def changed_notes(before: Held, after: Held, is_over: Callable[[bytes], bool]) -> dict[str, bytes]:
    """All that is to be written so that the second is kept in place of the first. `is_over`: whose incarnation the log has removed."""
    notes = {} if after.ready_at == before.ready_at else {READY: _POSITION.pack(after.ready_at)}
    pages = {incarnation[0] for incarnation, life in after.lives.items() if before.lives.get(incarnation) != life}
    for first in pages:
        found = {incarnation: life for incarnation, life in after.lives.items() if incarnation[0] == first and not is_over(incarnation)}
        notes[page_of(first)] = pack_page(found)
    return notes


async def load_held(store: Store) -> Held:
    """What was kept. DamagedData if it cannot be read: what was granted must not be granted to somebody else."""
    lives: dict[bytes, Life] = {}
    for first in range(256):
        page = await store.get_note(page_of(first))
        if page is not None:
            lives |= unpack_page(page)
    ready = await store.get_note(READY)
    return Held(lives, 0 if ready is None else unpack_ready(ready))


async def granted_alone(store: Store, nodes: Iterable[NodeId]) -> dict[bytes, Life]:
    """What this node granted as long as it did so alone: lives without numbers, one of each node."""
    found: dict[bytes, Life] = {}
    for node in nodes:
        data = await store.get_note(note_of(node))
        if data is not None:
            incarnation, mark = unpack_granted(data)
            found = merged(found, {incarnation: Life(FIRST_NUMBER, mark)})
    return found
