"""Deleted records go for good, once no node has anything older (specs/22-purge.md).

Who holds the scene's key walks through its spaces, finds what is deleted by opening it, and tells the owners of the places, who ask every
node. What is done is gone, so a purge may end at any moment, and be begun again.
"""

from __future__ import annotations

from collections.abc import AsyncGenerator, Sequence
from contextlib import aclosing
from dataclasses import replace
from functools import partial

from scenefold.base.errors import LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.copies import check_no_shadow
from scenefold.client.patience import is_passing
from scenefold.client.progress import ProgressCallback, ProgressState, no_progress
from scenefold.client.purge_walk import Deletion, Purge, Tails, deleted_or_not, deletion_of
from scenefold.client.ranging import entries
from scenefold.client.reencryption import Pace
from scenefold.client.sealing import deleted_all
from scenefold.client.together import together
from scenefold.client.verifying import Key, NewerThanKnown
from scenefold.crypto import PURGE_DOMAIN, SigningKey
from scenefold.wire import UNSIGNED, BeginPurge, PurgeItem, PurgeOrder, PurgeRecords, RecordBytes, RecordsPurged
from scenefold.wire.purge_packets import PURGE_ITEMS_MAX

LOOK_RECORDS = 256
"""Read together: 16 MiB of the largest."""
COUNTED_AT_A_TIME = 4096
GATHERED = 1024
"""Deletions that are told at a time: a few orders for each owner."""
PURGE_S = 90.0
"""For an owner: it asks all nodes twice, and each may take a while to be still."""
ROUNDS = 6
"""How often what has to wait is tried at the end."""
PAUSE_S, PAUSE_S_MAX = 1.0, 15.0
BEGINNINGS_MAX = 2
"""Of one purge: who deletes all the time is not caught up with."""
_LATER = frozenset({RejectReason.NOT_MY_LOCATION, RejectReason.NOT_READY, RejectReason.POSITION_BEHIND, RejectReason.BUSY})


async def purge(
    access: SceneAccess,
    spaces: Sequence[SpaceId] = (),
    *,
    dry_run: bool = False,
    progress: ProgressCallback = no_progress,
    bytes_per_s: float | None = None,
) -> Purge:
    """Have all deleted records dropped that can go; of these spaces, by default of all. `dry_run`: only look which these are.

    `bytes_per_s`: of records that are looked at.
    LocalFault if we are no writer of the scene, or it has no such space, Refused while it is being rendered.
    """
    clock = access.calls.world.clock
    work = _Work(access, Purge(clock.now(), is_dry=dry_run), Pace(bytes_per_s), progress)
    await work.run(spaces)
    work.state.seconds = clock.now() - work.state.begun
    return work.state


class _Work:
    def __init__(self, access: SceneAccess, state: Purge, pace: Pace, progress: ProgressCallback) -> None:
        self.state = state
        self._pace = pace
        self._access = access
        self._clock = access.calls.world.clock
        self._progress = progress
        self._purged = 0
        """Below it an epoch has to be."""
        self._beginnings = 0
        self._ready: list[Deletion] = []
        self._later: list[Deletion] = []

    async def run(self, wanted: Sequence[SpaceId]) -> None:
        log = await self._access.read_log()
        self._purged = log.header.purged
        self._writer()
        for space in wanted:
            check_no_shadow(self._access.identity.layouts, log.state.space(space).id, "purge")
        spaces = [space.id for space in log.state.spaces.values() if not space.parent and (not wanted or space.id in wanted)]
        for space in spaces:
            await self._count(space)
        self.state.begun = self._clock.now()
        for space in spaces:
            await self._walk(space)
        await self._tell(self._ready)
        await self._try_again()

    def _writer(self) -> SigningKey:
        """LocalFault if we are none."""
        writer, identity = self._access.writer, self._access.identity
        if writer is None or not identity.may_write(writer.key_id):
            remedy = "ask an owner of the scene for the role of a writer: `scenectl scene grant`"
            raise LocalFault("this scene is open for reading only", where=f"scene {self._access.name}", remedy=remedy)
        return writer

    # -------------------------------------------------------------------------------------------------- the walk

    def _listed(self, space: SpaceId) -> aclosing[AsyncGenerator[tuple[Location, bytes], None]]:
        access = self._access
        return aclosing(entries(access.calls, access.identity.scene, space, FIRST, LAST, stale_ok=False))

    async def _count(self, space: SpaceId) -> None:
        async with self._listed(space) as listed:
            async for _ in listed:
                self.state.total += 1
                if self.state.total % COUNTED_AT_A_TIME == 0:
                    self._progress(ProgressState("count", self.state.total, None, "records"))

    async def _walk(self, space: SpaceId) -> None:
        tails = None if self._access.identity.node_managed.get(space) else Tails()
        batch: list[tuple[Location, bytes]] = []
        async with self._listed(space) as listed:
            async for entry in listed:
                batch.append(entry)
                if len(batch) == LOOK_RECORDS:
                    await self._look(space, batch, tails)
                    batch = []
        await self._look(space, batch, tails)
        if tails is not None:
            self._ready += tails.end()
            self.state.kept += tails.kept

    async def _look(self, space: SpaceId, batch: Sequence[tuple[Location, bytes]], tails: Tails | None) -> None:
        keys: list[Key] = [(space, location, object_id) if object_id else (space, location) for location, object_id in batch]
        records = await self._access.fetch(keys) if keys else []
        wait_s = self._pace.wait_s(self._clock.now(), sum(len(record.ciphertext) for record in records if record is not None))
        if wait_s > 0:
            await self._clock.sleep(wait_s)
        gone = await self._deleted(keys, records)
        for (location, object_id), record, is_deleted in zip(batch, records, gone, strict=True):
            if record is None:
                # It went since it was listed: a gap.
                continue
            deletion = deletion_of(space, location, object_id, record) if is_deleted else None
            self.state.deleted += is_deleted
            if tails is not None:
                self._ready += tails.show(location, deletion)
            elif deletion is not None:
                self._ready.append(deletion)
        self.state.walked += len(batch)
        if len(self._ready) >= GATHERED:
            ready, self._ready = self._ready, []
            await self._tell(ready)
        self._progress(self.state.progress(self._clock.now()))

    async def _deleted(self, keys: Sequence[Key], records: Sequence[RecordBytes | None]) -> list[bool]:
        try:
            return await self._access.understood(deleted_all, keys, records)
        except (NewerThanKnown, Refused) as problem:
            if isinstance(problem, Refused) and problem.reason is not RejectReason.KEY_REVOKED:
                raise
            return await self._access.in_crypto_lane(deleted_or_not, self._access.identity, keys, records)

    # ------------------------------------------------------------------------------------------------- the owners

    async def _tell(self, deletions: Sequence[Deletion]) -> None:
        """Have them dropped; what cannot go now is tried again in the end."""
        self.state.can_go += len(deletions)
        if self.state.is_dry:
            return
        if any(deletion.epoch >= self._purged for deletion in deletions):
            await self._begin()
        begun = [deletion for deletion in deletions if deletion.epoch < self._purged]
        self.state.not_begun += len(deletions) - len(begun)
        self._later += await self._round(begun)
        self.state.waiting = len(self._later)

    async def _begin(self) -> None:
        """Nothing that was signed until now is taken any more; owners alone can do that."""
        log = self._access.log
        if self._beginnings == BEGINNINGS_MAX or log is None:
            return
        if log.keys.header_seed is None:
            await self._access.refresh()  # it may have been given since
            if log.keys.header_seed is None:
                return
        self._beginnings += 1
        self._purged = (await self._access.change_log(lambda _: BeginPurge())).header.purged

    async def _try_again(self) -> None:
        pause_s = PAUSE_S
        for _ in range(ROUNDS):
            if not self._later:
                return
            self._progress(self.state.progress(self._clock.now()))
            await self._clock.sleep(pause_s)
            pause_s = min(PAUSE_S_MAX, 2 * pause_s)
            await self._access.calls.refresh()
            later, self._later = self._later, []
            self._later = await self._round(later)
            self.state.waiting = len(self._later)

    async def _round(self, deletions: Sequence[Deletion]) -> list[Deletion]:
        """Tell each owner once; which have to wait."""
        owners: dict[str, list[Deletion]] = {}
        await self._access.calls.learn()
        for deletion in deletions:
            owners.setdefault(self._access.calls.to_ask(deletion.home)[0].address, []).append(deletion)
        later: list[Deletion] = []
        await together(partial(self._tell_owner, address, found, later) for address, found in owners.items())
        return later

    async def _tell_owner(self, address: str, deletions: Sequence[Deletion], later: list[Deletion]) -> None:
        for start in range(0, len(deletions), PURGE_ITEMS_MAX):
            frame: Sequence[Deletion] = deletions[start : start + PURGE_ITEMS_MAX]
            while frame:
                frame = await self._tell_frame(address, frame, later)

    async def _tell_frame(self, address: str, frame: Sequence[Deletion], later: list[Deletion]) -> Sequence[Deletion]:
        """One order; what of it is to be told again at once, without the others."""
        try:
            packet = PurgeRecords(await self._access.in_crypto_lane(self._order, [deletion.item for deletion in frame]))
            async with self._access.calls.turn(address):
                reply = await self._access.calls.ask(address, packet, RecordsPurged, timeout_s=PURGE_S)
            if len(reply.reasons) != len(frame):
                raise PeerFault(f"{len(reply.reasons)} answers for {len(frame)} deletions", where=address)
        except (Refused, Unreachable, PeerFault) as problem:
            if isinstance(problem, Refused) and not (is_passing(problem.reason) or problem.reason in _LATER):
                raise
            self.state.say(str(problem))
            later += frame
            return ()
        again: list[Deletion] = []
        for deletion, reason in zip(frame, reply.reasons, strict=True):
            match reason:
                case 0:
                    self.state.purged += 1
                case RejectReason.STALE_VERSION:
                    self.state.overtaken += 1
                case RejectReason.BUSY:
                    again.append(deletion)
                case _:
                    self.state.say(reply.text)
                    later.append(deletion)
        if len(again) == len(frame):
            later += again
            return ()
        return again

    def _order(self, items: Sequence[PurgeItem]) -> PurgeOrder:
        """Signed. Runs in the crypto lane."""
        writer, identity = self._writer(), self._access.identity
        order = PurgeOrder(identity.scene, identity.position, writer.key_id, tuple(items), UNSIGNED)
        return replace(order, signature=writer.sign(PURGE_DOMAIN, order.signable(identity.genesis)))
