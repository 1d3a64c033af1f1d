"""Records that lie in parts, read as if they were whole (specs/18-data.md, Splitting and merging).

Between an entry point and its parts somebody may merge them. So what does not fit is read again, and is damaged only if the very same entry
point is still there.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_TRIES_MAX
from scenefold.base.reasons import RejectReason
from scenefold.client.sealing import Opened
from scenefold.client.verifying import Key
from scenefold.scene.payloads.splits import SplitEntry, decode_entry, decode_part, is_part, is_split, whole_of

Result = TypeVar("Result")
Read = Callable[[Sequence[Key]], Awaitable[list[Opened | None]]]
Run = Callable[..., Awaitable[Result]]
_TOGETHER = 16 * CLIENT_GET_KEYS
"""Parts that are read together: 60 MiB of the largest."""


async def wholes(
    found: Sequence[Opened | None], keys: Sequence[Key], read: Read, run: Run[list[Opened | DamagedData]]
) -> list[Opened | None]:
    """The records as they were before they were split, versions and positions those of their entry points; of a part its content alone.

    `found`: what lies at `keys`. `read` gives what lies at others, and `run` runs a function in a worker thread.
    DamagedData if a part is missing, or not the one that was named; Refused if a record is written again and again meanwhile.
    """
    now = list(found)
    pending = [index for index, one in enumerate(now) if one is not None and (is_split(one.payload) or is_part(one.payload))]
    for _ in range(CLIENT_TRIES_MAX):
        if not pending:
            return now
        met = {index: record for index in pending if (record := now[index]) is not None}
        entries = {index: _entry(keys[index], record) for index, record in met.items() if is_split(record.payload)}
        payloads = await _parts(entries, keys, read)
        made = await run(_made, keys, met, entries, payloads)
        failed = [index for index, one in zip(met, made, strict=True) if isinstance(one, DamagedData)]
        again = dict(zip(failed, await read([keys[index] for index in failed]), strict=True)) if failed else {}
        pending = []
        for index, one in zip(met, made, strict=True):
            if isinstance(one, Opened):
                now[index] = one
                continue
            newer = now[index] = again[index]
            if newer is not None and newer.version == met[index].version:
                raise one
            if newer is not None and (is_split(newer.payload) or is_part(newer.payload)):
                pending.append(index)
    if not pending:
        return now
    what = "a split record is written all the time while it is read"
    raise Refused(RejectReason.BUSY, what, where=_where(keys[pending[0]]), remedy="try again")


async def _parts(entries: Mapping[int, SplitEntry], keys: Sequence[Key], read: Read) -> dict[Key, bytes | None]:
    """The payloads of all parts, None for those that are not there."""
    wanted: dict[Key, None] = {(keys[index][0], part.location): None for index, entry in entries.items() for part in entry.parts}
    places = list(wanted)
    found: dict[Key, bytes | None] = {}
    for start in range(0, len(places), _TOGETHER):
        batch = places[start : start + _TOGETHER]
        for key, one in zip(batch, await read(batch), strict=True):
            found[key] = None if one is None or one.deleted else one.payload
    return found


def _made(
    keys: Sequence[Key], met: Mapping[int, Opened], entries: Mapping[int, SplitEntry], payloads: Mapping[Key, bytes | None]
) -> list[Opened | DamagedData]:
    """Each whole, or why there is none. Runs in a worker thread."""
    made: list[Opened | DamagedData] = []
    for index, one in met.items():
        key, entry = keys[index], entries.get(index)
        try:
            if entry is None:
                payload = decode_part(one.payload).payload_alone
            else:
                payload = whole_of(entry, key[1], [payloads[key[0], part.location] for part in entry.parts])
        except DamagedData as damage:
            made.append(_damaged(key, damage))
        else:
            made.append(replace(one, payload=payload))
    return made


def _entry(key: Key, one: Opened) -> SplitEntry:
    try:
        return decode_entry(one.payload)
    except DamagedData as damage:
        raise _damaged(key, damage) from damage


def _damaged(key: Key, damage: DamagedData) -> DamagedData:
    remedy = "write the record anew, or bring it back from an archive"
    return type(damage)(damage.what, where=_where(key), remedy=remedy)


def _where(key: Key) -> str:
    return f"space {key[0]}, {key[1].hex()}"
