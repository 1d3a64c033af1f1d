"""What it takes to read and write one scene: its identity, the writer's key, a session, and the way to the nodes.

Space and importer build on the three calls here, which speak payloads on one side and wire on the other:
`put_drafts`, `get_opened`, `locations`. Sealing and opening happen in worker threads, a batch at a time.
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, TypeVar

from scenefold.base.errors import LocalFault, PeerFault, Refused
from scenefold.base.ids import NodeId, SpaceId
from scenefold.base.limits import CLIENT_BATCH_BYTES, CLIENT_TRIES_MAX, PAYLOAD_BYTES_MAX
from scenefold.base.location import Arc, Location
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.delivery import deliver, fetch
from scenefold.client.scene_log import LogAccess, ReadLog
from scenefold.client.sealing import Draft, Opened, SceneIdentity, open_all, seal_all
from scenefold.client.split import frames
from scenefold.client.together import together
from scenefold.client.versions import Sequencer
from scenefold.crypto import NONCE_BYTES, RecordHeader, SigningKey
from scenefold.scene.log import SceneLog
from scenefold.wire import EXPECT_ABSENT, LogEntry, PutItem, QueryRange, RejectRange, ReturnRange

Result = TypeVar("Result")

_BEHIND = frozenset({RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED})
"""What a node says to whoever signs under a log position that is over."""


class Wish(NamedTuple):
    """A payload and where it shall lie. `expect`: None, ABSENT, or the digest of what it replaces."""

    space: SpaceId
    location: Location
    payload: bytes
    expect: bytes | None = None
    content_position: int | None = None
    """The log position that coordinates in the payload belong to; None: that of the log as the scene knows it."""


class Placed(NamedTuple):
    """What became of a wish: `reason` 0 is durable; `digest` is that of our record, `node` the one that answered."""

    reason: int
    digest: bytes
    node: NodeId


@dataclass(eq=False)
class SceneAccess:
    """One scene as one client sees it. `writer` None: it can only be read."""

    calls: Calls
    name: str
    identity: SceneIdentity
    writer: SigningKey | None
    session: int = 0
    sequencer: Sequencer = field(default_factory=Sequencer)
    log: LogAccess | None = None
    """None: nothing is known of the scene's log, and records are written at the position of `identity`."""

    async def put(self, wishes: Sequence[Wish]) -> list[Placed]:
        """Seal, send, and wait until every record is durable or refused for its version.

        A wish that may replace what is there is given a higher version and sent again if a newer one was there.
        Refused for any other reason than a stale version; Unreachable if an owner stays away.
        """
        await self._check_mode(wishes)
        placed: list[Placed | None] = [None] * len(wishes)
        pending = list(range(len(wishes)))
        refreshed = False
        for _ in range(CLIENT_TRIES_MAX):
            items = await self._seal([wishes[index] for index in pending])
            outcomes = await deliver(self.calls, items)
            behind: list[int] = []
            for index, item, outcome in zip(pending, items, outcomes, strict=True):
                placed[index] = Placed(outcome.reason, digest_of(item), outcome.node)
                if outcome.reason in _BEHIND and not refreshed and self.log is not None:
                    behind.append(index)
                elif outcome.reason not in (0, RejectReason.STALE_VERSION):
                    raise self._refused(outcome.reason, item)
            if behind:
                # The log went on without us. What was not stored is signed anew, under the position that is known now.
                await self.refresh()
                await self._check_mode([wishes[index] for index in behind])
                refreshed = True
            stale = [index for index in pending if _is_stale(placed[index]) and wishes[index].expect != EXPECT_ABSENT]
            if not stale:
                pending = behind
            else:
                there = await self.get([(wishes[index].space, wishes[index].location) for index in stale])
                # What was expected is there, yet ours was not newer: this clock is behind that of the version's writer.
                pending = behind + [index for index, found in zip(stale, there, strict=True) if _may_replace(wishes[index], found)]
            if not pending:
                break
        else:
            remedy = "somebody else writes there all the time; try again"
            raise Refused(RejectReason.BUSY, f"{len(pending)} records are overtaken again and again", remedy=remedy)
        return [outcome for outcome in placed if outcome is not None]

    async def refresh(self) -> None:
        """Take the newest public header: what is written from now on is written under its position."""
        if self.log is not None:
            header = await self.log.header(self.identity.position + 1)
            if header is not None and header.position > self.identity.position:
                self.identity = self.identity.with_header(header)

    async def read_log(self) -> ReadLog:
        """The newest log. Payloads that are written from now on hold coordinates as it says."""
        return self._known(await self._log_or_fault().newest())

    async def change_log(self, entry_of: Callable[[SceneLog], LogEntry]) -> ReadLog:
        """Bring an entry into the log; see `LogAccess.propose`."""
        return self._known(await self._log_or_fault().propose(entry_of))

    def _known(self, log: ReadLog) -> ReadLog:
        if log.header.position >= self.identity.position:
            self.identity = replace(self.identity.with_header(log.header), content_position=log.header.position)
        return log

    def _log_or_fault(self) -> LogAccess:
        if self.log is None:
            raise LocalFault("the log of this scene is not known here", where=f"scene {self.name}")
        return self.log

    async def _check_mode(self, wishes: Sequence[Wish]) -> None:
        """An author writes nothing that is no output while the scene is being rendered (consensus.md §7)."""
        if self._is_frozen(wishes):
            await self.refresh()
        if self._is_frozen(wishes):
            remedy = "switch it back to edit mode first"
            raise Refused(RejectReason.MODE_FORBIDS, "the scene is in render mode", where=f"scene {self.name}", remedy=remedy)

    def _is_frozen(self, wishes: Sequence[Wish]) -> bool:
        outputs = self.identity.outputs
        return outputs is not None and any(wish.space not in outputs for wish in wishes)

    async def get(self, keys: Sequence[tuple[SpaceId, Location]]) -> list[Opened | None]:
        """Fetch, verify and decrypt; None where nothing is. DamagedData if a record does not verify."""
        records = await fetch(self.calls, self.identity.scene, self.identity.position, keys)
        sizes = [0 if record is None else len(record.ciphertext) for record in records]
        opened: list[Opened | None] = []
        for batch in frames(range(len(keys)), sizes, CLIENT_BATCH_BYTES):
            part = [keys[index] for index in batch], [records[index] for index in batch]
            opened += await self.in_crypto_lane(open_all, self.identity, *part)
        self.sequencer.saw(max((found.seq for found in opened if found is not None), default=0))
        return opened

    async def locations(self, space: SpaceId, first: Location, last: Location) -> AsyncIterator[Location]:
        """Locations of a space that hold records, from `first` to `last`, in order; asked for as they are used."""
        at: Location | None = first
        end = last
        while at is not None and at <= last:
            reply = await self._query(space, at, min(end, last))
            if isinstance(reply, RejectRange):
                end = self._shorter(reply, at, min(end, last))
                continue
            for location in reply.locations:
                yield location
            at, end = reply.last.next(), last

    async def in_crypto_lane(self, function: Callable[..., Result], *arguments: object) -> Result:
        return await self.calls.world.workers.run("crypto", function, *arguments)

    async def _query(self, space: SpaceId, first: Location, last: Location) -> ReturnRange | RejectRange:
        async def ask() -> ReturnRange | RejectRange:
            owner, arc = next(pair for pair in self.calls.table.arcs() if first in pair[1])
            piece = arc.intersection(Arc(first, last))
            assert piece is not None
            packet = QueryRange(self.identity.scene, space, piece.first, piece.last)
            reply = await self.calls.ask(owner.address, packet, (ReturnRange, RejectRange))
            if isinstance(reply, RejectRange):
                if reply.reason in (RejectReason.OUTSIDE_BOUNDS, RejectReason.NOT_MY_LOCATION):
                    # Our table is old: patiently() refreshes it before it asks again.
                    raise Refused(RejectReason.NOT_READY, "the range belongs to another node by now", where=owner.address)
                return reply
            assert isinstance(reply, ReturnRange)
            if reply.first != piece.first:
                raise PeerFault("a range answer begins elsewhere than its question", where=owner.address)
            return reply

        return await self.calls.patiently(ask)

    def _shorter(self, reply: RejectRange, first: Location, last: Location) -> Location:
        where = f"scene {self.name}, space {reply.space}"
        if reply.reason != RejectReason.TOO_LARGE_FOR_PACKET or first == last:
            raise Refused(reply.reason, "the node refused the range query", where=where)
        return Location.from_number((first.number + last.number) // 2)

    async def _seal(self, wishes: Sequence[Wish]) -> list[PutItem]:
        if self.writer is None:
            remedy = "open it with a profile that holds a writer's key"
            raise LocalFault("this scene is open for reading only", where=f"scene {self.name}", remedy=remedy)
        wall, token = self.calls.world.clock.wall(), self.calls.world.entropy.token
        drafts = [
            Draft(
                wish.space,
                wish.location,
                wish.payload,
                wish.expect,
                self.sequencer.next(wall),
                token(NONCE_BYTES),
                wish.content_position,
            )
            for wish in wishes
        ]
        items: list[PutItem] = []
        sizes = [len(draft.payload) for draft in drafts]
        for index, size in enumerate(sizes):
            if size > PAYLOAD_BYTES_MAX:
                where = f"scene {self.name}, space {drafts[index].space}, {drafts[index].location.hex()}"
                raise LocalFault(f"{size} bytes do not fit a record of {PAYLOAD_BYTES_MAX}", where=where, remedy="split it")
        batches = list(frames(range(len(drafts)), sizes, CLIENT_BATCH_BYTES))
        sealed: list[list[PutItem]] = [[] for _ in batches]

        async def seal(number: int, batch: list[int]) -> None:
            part = [drafts[index] for index in batch]
            sealed[number] = await self.in_crypto_lane(seal_all, self.identity, self.writer, self.session, part)

        await together(partial(seal, number, batch) for number, batch in enumerate(batches))
        for part in sealed:
            items += part
        return items

    def _refused(self, reason: int, item: PutItem) -> Refused:
        where = f"scene {self.name}, space {item.space}, {item.location.hex()}"
        remedy = "free space on the nodes or add a node" if reason == RejectReason.STORAGE_FULL else ""
        words = RejectReason(reason).name.lower().replace("_", " ")
        return Refused(RejectReason(reason), f"the record was refused: {words}", where=where, remedy=remedy)


def digest_of(item: PutItem) -> bytes:
    """The digest that `expect` speaks of."""
    return RecordHeader.decode(item.header).digest


def _may_replace(wish: Wish, there: Opened | None) -> bool:
    """Whether a wish that was refused for its version wants what is there now replaced."""
    return wish.expect is None or (there is not None and there.digest == wish.expect)


def _is_stale(placed: Placed | None) -> bool:
    return placed is not None and placed.reason == RejectReason.STALE_VERSION
