"""Records in: packets 10 and 32 (Algorithm 6; specs/18-data.md, Writes).

A write is judged by the owner of its place alone, a node-managed record's by that of its home: verified in worker threads, made
durable, then acknowledged, under a lease. Offered to the wrong node it is refused with the owner's id. A place that is just
being given away takes no writes for the moment of its last copy; they wait, but not for long.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AsyncExitStack

import trio

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, SceneId
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.crypto import PLACED_BY_NODE
from scenefold.peer.handlers import Handlers
from scenefold.peer.holdings import Holdings, Known, Lease, Owners, other_owner
from scenefold.peer.records.copying import TOLD_S_MAX, Copying, NotKept
from scenefold.peer.records.fence import Fence
from scenefold.peer.records.verification import KnownScene, epochs_of, home_of, verify_all
from scenefold.peer.scene_log.scenes import Scenes
from scenefold.store import Outcome, Put, PutResult, Store
from scenefold.wire import AcceptData, Packet, ProposeData, PutItem, PutMany, PutManyReply, PutOutcome, RejectData
from scenefold.world import World
from scenefold.world.metering import charge_forged

VERIFY_BATCH = 128
"""Records that one call in a worker thread verifies: some 10 ms."""
NEVER_HONEST = (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED)
"""Why no record of an honest program is refused."""
FORGED_MAX = 64
"""Of such records a write may hold; after a batch that brings more, the rest of it is not looked at."""
SCENES_MAX = 8
"""Scenes of the records of one write; our clients write to one at a time. Each that is unknown sets off a question to every node."""
FROZEN_S_MAX = 2.0
"""How long a write waits for a frozen place: the last copy of a handover takes less, or the client asks again."""


class Writes:
    """The owner's side of every write."""

    def __init__(
        self,
        world: World,
        store: Store,
        scenes: Scenes,
        line: Holdings,
        lease: Lease,
        owners: Owners,
        me: NodeId,
        copying: Copying,
        known: Known,
        fence: Fence,
    ) -> None:
        self._world = world
        self._store = store
        self._scenes = scenes
        self._line = line
        self._lease = lease
        self._owners = owners
        self._me = me
        self._copying = copying
        self._known = known
        self._fence = fence

    def register(self, handlers: Handlers) -> None:
        handlers.add(ProposeData, self._on_propose)
        handlers.add(PutMany, self._on_put_many)

    async def put(self, items: Sequence[PutItem], asker: str = "") -> list[PutOutcome]:
        """Verify and store; an outcome for each item, in order. What is stored is durable when this returns."""
        outcomes, scenes = await self._sorted(items, asker)
        open_ones = [index for index, outcome in enumerate(outcomes) if outcome is None]
        puts: list[tuple[int, Put]] = []
        forged = 0
        for start in range(0, len(open_ones), VERIFY_BATCH):
            batch = open_ones[start : start + VERIFY_BATCH]
            if forged > FORGED_MAX:
                for index in batch:
                    outcomes[index] = _outcome(items[index], RejectReason.LIMIT_EXCEEDED)
                continue
            claims = [(items[index], scenes[items[index].scene]) for index in batch]
            verdicts = await self._world.workers.run("crypto", verify_all, claims)
            bad = sum(isinstance(verdict, Refused) and verdict.reason in NEVER_HONEST for verdict in verdicts)
            forged += bad
            charge_forged(bad)  # At once: who hangs up has paid.
            for index, verdict in zip(batch, verdicts, strict=True):
                if isinstance(verdict, Refused):
                    outcomes[index] = _outcome(items[index], verdict.reason)
                else:
                    puts.append((index, verdict))
        puts = await self._looked_up(items, puts, outcomes)
        results = await self._store_all([put for _, put in puts], scenes)
        for (index, _), result in zip(puts, results, strict=True):
            outcomes[index] = self._judged(items[index], result)
        return [outcome for outcome in outcomes if outcome is not None]

    async def _sorted(self, items: Sequence[PutItem], asker: str) -> tuple[list[PutOutcome | None], dict[SceneId, KnownScene]]:
        """The outcomes of records that need not be looked at, None for the others; and the scenes of these."""
        outcomes = [self._refused_unseen(item) for item in items]
        open_ones = [item for item, outcome in zip(items, outcomes, strict=True) if outcome is None]
        scenes, reasons, has_waited = await self._scenes_of(open_ones, asker)
        for index, item in enumerate(items):
            if outcomes[index] is None and has_waited:
                # What was ours may be somebody else's by now.
                outcomes[index] = self._refused_unseen(item)
            if outcomes[index] is None and item.scene in reasons:
                outcomes[index] = _outcome(item, reasons[item.scene])
        return outcomes, scenes

    def _refused_unseen(self, item: PutItem) -> PutOutcome | None:
        """The outcome of what need not be looked at: others' places, no lease. Nobody is asked about the scenes of such."""
        home = home_of(item)
        if not self._line.owns(home):
            return self._not_ours(item, home)
        if not self._lease.holds():
            # Our own id: whoever wrote need not fear that it is here.
            return PutOutcome(RejectReason.NOT_READY, item.location, self._me)
        return None

    def _not_ours(self, item: PutItem, place: Location) -> PutOutcome:
        try:
            return PutOutcome(RejectReason.NOT_MY_LOCATION, item.location, other_owner(self._owners, place, self._me))
        except Refused as refusal:
            return _outcome(item, refusal.reason)

    async def _looked_up(
        self, items: Sequence[PutItem], puts: Sequence[tuple[int, Put]], outcomes: list[PutOutcome | None]
    ) -> list[tuple[int, Put]]:
        """Those of the puts whose places are known: what else was acknowledged there might be newer, or not what the writer expects."""
        if self._known.is_quiet:
            return list(puts)
        homes = [home_of(items[index]) for index, _ in puts]
        await self._known.look_up(homes, trio.current_time() + TOLD_S_MAX)
        unknown = {index for (index, _), home in zip(puts, homes, strict=True) if not self._known.is_known(home)}
        for index in unknown:
            outcomes[index] = PutOutcome(RejectReason.NOT_READY, items[index].location, self._me)
        return [(index, put) for index, put in puts if index not in unknown]

    async def _store_all(self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene]) -> list[PutResult | NotKept | RejectReason]:
        """Store while nothing of it is frozen; BUSY for all if that lasts too long. Where a space has copies, return once enough have it."""
        if not puts:
            return []
        async with AsyncExitStack() as stack:
            with trio.move_on_after(FROZEN_S_MAX) as patience:
                headers = [put.record.header for put in puts]
                places = [header.location for header in headers if header.placement != PLACED_BY_NODE]
                await stack.enter_async_context(self._line.writing(places, anywhere=len(places) < len(puts)))
            if patience.cancelled_caught:
                return [RejectReason.BUSY] * len(puts)
            # While records were looked at, a header may have come by which they must not be stored any more.
            newest = self._newest(scenes)
            results: list[PutResult | NotKept | RejectReason | None] = [_forbidden(put, newest) for put in puts]
            allowed = [put for put, result in zip(puts, results, strict=True) if result is None]
            with self._fence.storing({scene: known.public.position for scene, known in newest.items()}):
                stored = iter(await self._put(allowed, scenes, newest))
            return [next(stored) if result is None else result for result in results]

    async def _put(
        self, puts: Sequence[Put], scenes: Mapping[SceneId, KnownScene], newest: Mapping[SceneId, KnownScene]
    ) -> Sequence[PutResult | NotKept]:
        results: list[PutResult | NotKept] = []
        if not puts:
            return results
        if any(known.turns or any(known.layouts.values()) for known in newest.values()):
            return await self._copying.put(puts, scenes)
        with trio.CancelScope(shield=True):
            # Whoever asked may hang up, and the store have begun: a reader waits until it is on the disk.
            results += await self._store.put(puts)
        return results

    def _judged(self, item: PutItem, result: PutResult | NotKept | RejectReason) -> PutOutcome:
        """What is said of a result at this very moment: without a lease nothing that a later owner could contradict."""
        if not isinstance(result, PutResult):
            reason, node = result if isinstance(result, NotKept) else (result, NodeId(0))
            return PutOutcome(reason, item.location, node)
        if result.outcome is Outcome.NOT_OWNED:
            return self._not_ours(item, home_of(item))
        if not self._lease.holds():
            return _outcome(item, RejectReason.NOT_READY)
        return PutOutcome(result.reason or 0, item.location if result.location is None else result.location, NodeId(0))

    async def _scenes_of(self, items: Sequence[PutItem], asker: str) -> tuple[dict[SceneId, KnownScene], dict[SceneId, RejectReason], bool]:
        """The scenes of these records; why there is none, of the others; and whether anybody was waited for."""
        scenes: dict[SceneId, KnownScene] = {}
        too_many = list(dict.fromkeys(item.scene for item in items))[SCENES_MAX:]
        reasons = dict.fromkeys(too_many, RejectReason.LIMIT_EXCEEDED)
        has_waited = False
        for scene, epoch in epochs_of(item for item in items if item.scene not in reasons).items():
            try:
                known = await self._here(scene)
                if known is None or known.public.position < epoch:
                    has_waited = True
                    known = await self._scenes.known(scene, position=epoch, asker=asker)
                scenes[scene] = known
            except Refused as refusal:
                reasons[scene] = refusal.reason
        return scenes, reasons, has_waited

    def _newest(self, scenes: Mapping[SceneId, KnownScene]) -> dict[SceneId, KnownScene]:
        """As they are by now: since they were looked up, a space may have come to have copies, or the mode have changed."""
        return {scene: self._scenes.here(scene) or known for scene, known in scenes.items()}

    async def _here(self, scene: SceneId) -> KnownScene | None:
        """What this node itself has of the scene; this waits for nobody."""
        try:
            return await self._scenes.known(scene, ask=False)
        except Refused:
            return None

    async def _on_put_many(self, packet: PutMany, peer: str) -> Packet:
        return PutManyReply(outcomes=tuple(await self.put(packet.items, peer)))

    async def _on_propose(self, packet: ProposeData, peer: str) -> Packet:
        item = PutItem(
            scene=packet.scene,
            space=packet.space,
            location=packet.location,
            signature=packet.signature,
            header=packet.header,
            ciphertext=packet.ciphertext,
        )
        (outcome,) = await self.put([item], peer)
        if outcome.reason == 0:
            return AcceptData(signature=packet.signature, location=outcome.location)
        reason = RejectReason(outcome.reason)
        behind = reason in (RejectReason.MODE_FORBIDS, RejectReason.KEY_REVOKED)
        public = (await self._scenes.known(packet.scene)).public if behind else None
        return RejectData(reason=reason, owner=outcome.owner, public=public)


def _forbidden(put: Put, scenes: Mapping[SceneId, KnownScene]) -> RejectReason | None:
    header = put.record.header
    for known in scenes.values():
        if known.public.genesis == header.genesis:
            try:
                known.check_mode(header)
            except Refused as refusal:
                return refusal.reason
    return None


def _outcome(item: PutItem, reason: RejectReason) -> PutOutcome:
    return PutOutcome(reason, item.location, NodeId(0))
