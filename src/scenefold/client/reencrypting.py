"""A scene's records, sealed anew under its newest key while others read and write (specs/16-scene-log.md, Members).

Walks all spaces, a few batches at a time, and puts what lies under an older key as compare-and-set: whoever else writes wins, and
wrote under the new key. It may end at any moment, and be begun again; memory is bounded by the batches under way.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from functools import partial

import trio

from scenefold.base.errors import DamagedData, LocalFault, Refused
from scenefold.base.ids import SpaceId
from scenefold.base.limits import CLIENT_GET_KEYS, CLIENT_TRIES_MAX
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.progress import ProgressCallback, ProgressState, no_progress
from scenefold.client.ranging import entries
from scenefold.client.reencryption import Pace, Reencryption, is_damaged, under_older_keys
from scenefold.client.sealing import Opened, SceneIdentity, open_all
from scenefold.client.together import worked_off
from scenefold.client.verifying import Key, NewerThanKnown
from scenefold.client.wishes import Placed, Wish
from scenefold.crypto import signed_place
from scenefold.wire import RecordBytes

_STORED = 0
_OWN_FAULTS = frozenset(
    {
        RejectReason.BUSY,
        RejectReason.DAMAGED,
        RejectReason.ILL_FORMED,
        RejectReason.OUTSIDE_BOUNDS,
        RejectReason.SIGNATURE_INVALID,
        RejectReason.TOO_LARGE_FOR_PACKET,
        RejectReason.UNKNOWN_SCENE_OR_SPACE,
    }
)
"""Refusals that may be for one record alone: not those for a scene that is rendered, a full disk, or rights that we have not. BUSY is
what is said in the end of a record that nothing newer can take the place of."""
COUNTED_AT_A_TIME = 4096
WALKS_MAX = 8
"""A walk that still finds something means that a node has not heard of the new key; it hears of it within seconds."""


async def reencrypt(access: SceneAccess, progress: ProgressCallback = no_progress, bytes_per_s: float | None = None) -> Reencryption:
    """Seal everything anew that lies under an older key than the scene's newest; ends when a walk finds nothing more.

    `bytes_per_s`: of records that are looked at. Refused if the scene is being rendered; LocalFault if we are no writer of it.
    To look what there is to do, see `look_what_is_to_seal`.
    """
    log = await access.read_log()
    clock = access.calls.world.clock
    work = _Work(access, Reencryption(log.state.grants.key_epoch, clock.now()), Pace(bytes_per_s), progress)
    spaces = [space.id for space in log.state.spaces.values() if not space.parent]
    state = work.state
    begun = clock.now()
    if state.key_epoch:
        await work.count(spaces)
    state.ended = not state.key_epoch
    while not state.ended and state.walks < WALKS_MAX:
        await work.walk(spaces)
        state.ended = not state.renewed_in_walk
    state.seconds = clock.now() - begun
    return state


async def look_what_is_to_seal(
    access: SceneAccess, progress: ProgressCallback = no_progress, bytes_per_s: float | None = None, *, new_key: bool = False
) -> Reencryption:
    """What `reencrypt` would have to do, by one walk that changes nothing. `new_key`: if the scene had got another key before.

    LocalFault if we may not do it, being no writer, or, for a new key, no owner.
    """
    log = await access.read_log()
    access.check_writer()
    if new_key:
        await access.log_or_fault().owner()
    clock = access.calls.world.clock
    begun = clock.now()
    state = Reencryption(log.state.grants.key_epoch + new_key, begun, is_dry=True)
    work = _Work(access, state, Pace(bytes_per_s), progress)
    spaces = [space.id for space in log.state.spaces.values() if not space.parent]
    if state.key_epoch:
        await work.count(spaces)
        await work.walk(spaces)
    state.ended = True
    state.seconds = clock.now() - begun
    return state


class _Work:
    def __init__(self, access: SceneAccess, state: Reencryption, pace: Pace, progress: ProgressCallback) -> None:
        self.state = state
        self._access = access
        self._pace = pace
        self._progress = progress

    async def count(self, spaces: Sequence[SpaceId]) -> None:
        """How many records there are, for whoever wants to know how long it takes."""
        for space in spaces:
            async with self._listed(space) as listed:
                async for _ in listed:
                    self.state.total += 1
                    if self.state.total % COUNTED_AT_A_TIME == 0:
                        self._progress(ProgressState("count", self.state.total, None, "records"))

    async def walk(self, spaces: Sequence[SpaceId]) -> None:
        """Once over all records."""
        self.state.begin_walk()
        self.state.begun = self._access.calls.world.clock.now()
        self.state.unreadable = 0
        await worked_off(partial(self._list, spaces), self._renew_all)

    async def _list(self, spaces: Sequence[SpaceId], send: trio.MemorySendChannel[list[Key]]) -> None:
        for space in spaces:
            batch: list[Key] = []
            async with self._listed(space) as listed:
                async for location, object_id in listed:
                    batch.append((space, location, object_id) if object_id else (space, location))
                    if len(batch) == CLIENT_GET_KEYS:
                        await send.send(batch)
                        batch = []
            if batch:
                await send.send(batch)

    def _listed(self, space: SpaceId) -> aclosing[AsyncGenerator[tuple[Location, bytes], None]]:
        """All places of a space; closed where the walk is ended in the midst of them."""
        access = self._access
        return aclosing(entries(access.calls, access.identity.scene, space, FIRST, LAST, stale_ok=False))

    async def _renew_all(self, batch: Sequence[Key]) -> None:
        keys = batch
        for _ in range(CLIENT_TRIES_MAX):
            keys = await self._renew(keys)
            if not keys:
                break
        else:
            # Whoever wrote there wrote under the new key; a node that says otherwise is not one to wait for.
            for key in keys:
                self.state.complain(f"space {key[0]}, {key[1].hex()}: its owner takes no newer version, and shows none")
        self.state.walked += len(batch)
        self._progress(self.state.progress(self._access.calls.world.clock.now()))

    async def _renew(self, keys: Sequence[Key]) -> Sequence[Key]:
        """Seal anew what needs it; gives what somebody else wrote meanwhile, to be looked at again."""
        clock = self._access.calls.world.clock
        records = await self._access.fetch(keys)
        wait_s = self._pace.wait_s(clock.now(), sum(len(record.ciphertext) for record in records if record is not None))
        if wait_s > 0:
            await clock.sleep(wait_s)
        for key, record in zip(keys, records, strict=True):
            if is_damaged(record):
                self.state.complain(f"space {key[0]}, {key[1].hex()}: the record is damaged at its owner")
        identity = self._access.identity
        newest = identity.keys.newest_epoch if identity.key_epoch is None else identity.key_epoch
        old = under_older_keys(records, self.state.key_epoch if self.state.is_dry else newest)
        if self.state.is_dry:
            self.state.find(len(old), sum(len(record.ciphertext) for record in map(records.__getitem__, old) if record is not None))
        if self.state.is_dry or not old:
            return ()
        wishes = await self._wishes([keys[index] for index in old], [records[index] for index in old])
        tried, placed = await self._placed(wishes)
        done = [wish for wish, outcome in zip(tried, placed, strict=True) if outcome.reason == _STORED]
        self.state.renew(len(done), sum(len(wish.payload) for wish in done))
        overtaken = [wish.key for wish, outcome in zip(tried, placed, strict=True) if outcome.reason != _STORED]
        self.state.overtaken += len(overtaken)
        return overtaken

    async def _placed(self, wishes: Sequence[Wish]) -> tuple[Sequence[Wish], Sequence[Placed]]:
        """Put them; gives those that were taken or overtaken. Whatever cannot be put for a reason of its own is complained about, and left.

        What a batch that was refused had stored of it meets itself then, and counts as overtaken.
        """
        try:
            return wishes, await self._access.put(wishes)
        except Refused as problem:
            if problem.reason not in _OWN_FAULTS:
                raise
        taken: list[tuple[Wish, Placed]] = []
        problems: list[Refused] = []
        for wish in wishes:
            try:
                taken += zip([wish], await self._access.put([wish]), strict=True)
            except Refused as problem:
                if problem.reason not in _OWN_FAULTS:
                    raise
                problems.append(problem)
        if len(wishes) > 1 and not taken and all(one.reason is RejectReason.BUSY for one in problems):
            raise problems[-1]  # not the records' fault
        for one in problems:
            self.state.complain(str(one))
        return [wish for wish, _ in taken], [placed for _, placed in taken]

    async def _wishes(self, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[Wish]:
        try:
            opened = await self._access.understood(opened_each, keys, records)
        except (NewerThanKnown, Refused) as problem:
            if isinstance(problem, Refused) and problem.reason is not RejectReason.KEY_REVOKED:
                raise
            opened = await self._access.in_crypto_lane(opened_or_not, self._access.identity, keys, records)
        wishes = []
        for key, found in zip(keys, opened, strict=True):
            if isinstance(found, Opened):
                object_id = key[2] if len(key) == 3 else b""
                place = signed_place(object_id) if object_id else key[1]
                try:
                    self._access.identity.check_kind(key[0], object_id)
                except LocalFault as odd:
                    self.state.complain(str(odd))
                    continue
                wishes.append(Wish(key[0], place, found.payload, found.digest, found.content_position, object_id))
            elif found is not None:
                self.state.complain(str(found))
        return wishes


def opened_each(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[Opened | DamagedData | None]:
    """Each record, or what is wrong with it. NewerThanKnown is raised: the scene may have to be known better."""
    return [_opened(identity, key, record, True) for key, record in zip(keys, records, strict=True)]


def opened_or_not(identity: SceneIdentity, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[Opened | DamagedData | None]:
    """The same once no more can be known of the scene."""
    return [_opened(identity, key, record, False) for key, record in zip(keys, records, strict=True)]


def _opened(identity: SceneIdentity, key: Key, record: RecordBytes | None, is_first: bool) -> Opened | DamagedData | None:
    try:
        return open_all(identity, [key], [record])[0]
    except NewerThanKnown as unknown:
        if is_first:
            raise
        return unknown
    except DamagedData as damage:
        return damage
