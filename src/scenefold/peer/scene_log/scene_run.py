"""The log of one scene at a node that takes part in it, or did (specs/16-scene-log.md, On nodes).

Here the log alone says what is decided: a header that somebody shows makes it ask for what lies before. Only where nobody tells that any more
does it begin anew behind such a header.
"""

from __future__ import annotations

import logging
from collections import OrderedDict
from collections.abc import Callable

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Setting
from scenefold.peer.logs import AT_ONCE_BYTES, Log, open_log
from scenefold.peer.logs.links import NodePorts
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.consent import Consent
from scenefold.peer.modes.scene_modes import SceneModes
from scenefold.peer.peers import Peers
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.scene_judge import SceneJudge
from scenefold.peer.scene_log.scene_owner import SceneOwner
from scenefold.peer.scene_log.turns import Turns
from scenefold.peer.waiters import Waiters
from scenefold.scene.log import check_log
from scenefold.store import Store
from scenefold.store.log_rows import Votes
from scenefold.store.logs import Beside
from scenefold.wire import RequestSceneLog, RespondSceneLog, SceneLogPublic, Want
from scenefold.world import Priority, World

CATCH_UP_S = 2.0
"""For a log to come to what was shown."""
LOOK_S = 10.0
"""Between two looks whether the log lies behind what was shown, and between two times of asking for a sealed log."""
STUCK_LOOKS = 3
"""After so many without any progress nobody has what this node lacks."""
LOG_S_MAX = 5.0
"""For one node to send a sealed log."""
REMEMBERED = 1_024
"""Positions of which is known when this node learnt them."""
RECENT = 8
DISK_PAUSE_S = 1.0
ROWS_MAX, ROWS_BYTES_MAX = 64, 4 * 1024 * 1024

_log = logging.getLogger("scenefold.peer.scene_log.scenes")


class SceneRun:
    """`run` it in one task. `log` is there once it is `opened`, and another one after it has begun anew."""

    log: Log

    def __init__(
        self,
        world: World,
        store: Store,
        peers: Peers,
        own: OwnStatus,
        ports: NodePorts,
        known: KnownScene,
        heard: Callable[[SceneRun, KnownScene, Decide | None], None],
        *,
        may_speak: Callable[[], bool],
        is_new: bool = False,
    ) -> None:
        """`may_speak`: whether this node may decide anything yet; `restate` tells that this has changed. `is_new`: this node takes part in it for the first time. `heard`: what becomes of the scene's newest header, with what decided it, None if that was learnt otherwise."""
        self._world, self._store, self._peers, self._own = world, store, peers, own
        self._ports, self._heard = ports, heard
        self.modes = SceneModes(world, peers, own, known.public, self._is_behind, is_new=is_new)
        """Who may act in which mode: leases, and when a mode is active."""
        self.owner = SceneOwner(known, self._on_decided, self.modes, may_speak)
        self.consent = Consent(world, peers, ports.around)
        """Whom a change of the mode needs beside those who decide."""
        self.opened = trio.Event()
        self.seen: OrderedDict[int, int] = OrderedDict()
        """When this node learnt a position: milliseconds since the epoch."""
        self.recent: OrderedDict[int, SceneLogPublic] = OrderedDict()
        """The newest decided headers, for who proposed one of them."""
        self.turns = Turns(world.clock)
        """Of those who want the next position."""
        self._news = Waiters()
        self._ahead: KnownScene | None = None
        self._scope = trio.CancelScope()
        self._stopped = trio.Event()

    @property
    def public(self) -> SceneLogPublic:
        return self.owner.known.public

    @property
    def takes_part(self) -> bool:
        """Whether this node decides the next position, and may."""
        return self.opened.is_set() and self._own.member in self.log.judge.participants and not self.log.is_silent

    @property
    def must_wait(self) -> bool:
        """Whether this node decides the next position, and may not before its life is known to the cluster's voters."""
        return self.opened.is_set() and self._own.member in self.log.judge.participants and not self.owner.speaks()

    def restate(self) -> None:
        """This node may decide from now on; a log that is only about to run looks by itself."""
        log = self._ports.logs.of(self.public.genesis)
        if log is not None:
            log.restate()

    # --------------------------------------------------------------------------------------------------- its task

    async def run(self, *, task_status: trio.TaskStatus[None] = trio.TASK_STATUS_IGNORED) -> None:
        """Until cancelled, or stopped. An error of the disk ends it, and with that the node; one that is full is waited for."""
        try:
            with self._scope:
                await self._run(task_status)
        finally:
            self._stopped.set()

    async def stop(self) -> None:
        """End it for good; returns once it has."""
        self._scope.cancel()
        await self._stopped.wait()

    async def _run(self, task_status: trio.TaskStatus[None]) -> None:
        while True:
            try:
                self.log = await self._open()
            except Refused as problem:
                _log.warning("the log of scene %08x is not opened: %s", self.public.scene, problem)
                task_status.started()
                task_status = trio.TASK_STATUS_IGNORED
                await self._world.clock.sleep(DISK_PAUSE_S)
                continue
            self._ports.logs.add(self.log)
            try:
                async with trio.open_nursery() as nursery:
                    await nursery.start(self.log.run)
                    nursery.start_soon(self._keep_whole)
                    nursery.start_soon(self.modes.run)
                    self.opened.set()
                    task_status.started()
                    task_status = trio.TASK_STATUS_IGNORED
                    await self._stuck()
                    nursery.cancel_scope.cancel()
            finally:
                self._ports.logs.remove(self.log.genesis)

    async def _open(self) -> Log:
        await self._begin_anew()
        judge, genesis = SceneJudge.of(self.owner.known), self.public.genesis
        # More than the header says is on the disk only if that was lost, and had from somebody who knew less.
        while rows := await self._store.decided(genesis, judge.public.position, ROWS_MAX, ROWS_BYTES_MAX):
            for row in rows:
                if judge.refuses(row.value, is_decided=True) is not None:
                    where = f"scene {self.public.scene:08x}, position {row.position}"
                    raise DamagedData("what was decided makes no sense there", where=where, remedy="see to the disk, then wipe the folder")
                judge, decided = judge.after(row.value), Decide(*row)
                self.owner.beside(decided, judge)
                self.owner.decided(decided, judge)
        setting = Setting(genesis, self._own.member, self._own.key, at_once_bytes=AT_ONCE_BYTES)
        position = judge.public.position
        ports = self._ports
        return await open_log(self._world, self._store, setting, judge, ports.carrier, ports.around, self.owner, position=position)

    async def _begin_anew(self) -> None:
        """Behind the header that was shown, if that is far ahead: durably, header and votes together."""
        ahead = self._ahead
        if ahead is None or not self._is_stuck_before(ahead, self.public.position):
            return
        public, incarnation = ahead.public, self._own.incarnation
        stored = await self._store.read_log(public.genesis, self.public.position)
        silent_until = 0 if stored is None else stored.silent_until
        votes = Votes(incarnation, public.position + 1, silent_until=silent_until)
        await self._store.begin_log(public.genesis, votes, Beside({public.scene: public.encode()}))
        self._ahead = None
        self.owner.begins_at(ahead)
        self.modes.begins_at(public)
        self._take(ahead, None)

    async def _stuck(self) -> None:
        """Return once nobody tells what lies between here and what was shown."""
        looks, position = 0, self.log.position
        while looks < STUCK_LOOKS:
            await self._world.clock.sleep(LOOK_S)
            is_behind = self._ahead is not None and self._is_stuck_before(self._ahead, self.log.position)
            looks = looks + 1 if is_behind and self.log.position == position else 0
            position = self.log.position
        _log.warning("scene %08x: nobody tells what was decided behind position %d", self.public.scene, position)

    @staticmethod
    def _is_stuck_before(ahead: KnownScene, position: int) -> bool:
        """Whether nobody else need know what lies before. The next position itself is had by a majority of those who decided it, this node
        perhaps among them; but of a scene that was ended they may have let go of it, and nobody needs more than its header."""
        return ahead.public.position > position + (0 if ahead.is_ended else 1)

    # ------------------------------------------------------------------------------------------------------- news

    def _is_behind(self) -> None:
        if self.opened.is_set():
            self.log.catch_up(self.log.judge.participants.nodes)

    def _on_decided(self, known: KnownScene, decided: Decide) -> None:
        position = known.public.position
        self.seen[position] = int(self._world.clock.wall() * 1000)
        if len(self.seen) > REMEMBERED:
            self.seen.popitem(last=False)
        self._take(known, decided)

    def _take(self, known: KnownScene, decided: Decide | None) -> None:
        self.recent[known.public.position] = known.public
        if len(self.recent) > RECENT:
            self.recent.popitem(last=False)
        self._heard(self, known, decided)
        self._news.tell()

    def shown(self, known: KnownScene) -> None:
        """A header that was verified and decided."""
        if known.public.position <= self.public.position:
            return
        if self._ahead is None or self._ahead.public.position < known.public.position:
            self._ahead = known
        if self.opened.is_set():
            self.log.catch_up(entry.member.node for entry in known.public.participants)

    @property
    def shown_position(self) -> int:
        """The newest position that there is, as far as this node was shown."""
        return max(self.public.position, 0 if self._ahead is None else self._ahead.public.position)

    async def come_to(self, position: int, within_s: float) -> bool:
        """Whether the log comes to this position in time."""
        if self.public.position >= position or within_s <= 0:
            return self.public.position >= position
        with trio.move_on_after(within_s):
            await self._news.until(lambda: self.public.position >= position)
        return self.public.position >= position

    async def insist(self, position: int, within_s: float) -> None:
        """Refused (16) unless the log comes to this position in time."""
        if not await self.come_to(position, within_s):
            what = f"the scene's log has come to position {self.public.position} here"
            raise Refused(RejectReason.NOT_READY, what, remedy="try again in a while")

    # ------------------------------------------------------------------------------------------------- sealed log

    async def _keep_whole(self) -> None:
        """Have the sealed log of the newest position, which others decided while this node was no participant, or away."""
        public = self.public
        if await self._sealed() is None and self.public is public:
            self.owner.lacks_log = True
        while True:
            public = self.public
            if self.owner.lacks_log and await self._fetched() and self.public is public:
                self.owner.lacks_log = False
            await self._news.until(lambda: self.owner.lacks_log)
            await self._world.clock.sleep(1.0)

    async def _sealed(self) -> bytes | None:
        kept = await self._store.scene_with_log(self.public.scene)
        if kept is None:
            return None
        public, private = self.public, kept[1]
        try:
            await self._world.workers.run("crypto", check_log, public, private)
        except DamagedData:
            return None
        return private

    async def _fetched(self) -> bool:
        """Whether the newest position's log is here now."""
        public = self.public
        request = RequestSceneLog(public.scene, public.genesis, public.position, 0, Want.LOG)
        nodes = dict.fromkeys((*(entry.member.node for entry in public.participants), public.origin))
        for node in nodes:
            if node != self._own.me and await self._fetched_from(node, request, public):
                return True
        return False

    async def _fetched_from(self, node: NodeId, request: RequestSceneLog, public: SceneLogPublic) -> bool:
        try:
            answer = (await self._peers.ask(node, Priority.HIGH, request, RespondSceneLog, LOG_S_MAX)).answer
            if answer is None or answer.private is None or answer.public.log_hash != public.log_hash:
                return False
            await self._world.workers.run("crypto", check_log, public, answer.private)
            return await self._store.keep_scene_log(public.scene, public.encode(), answer.private)
        except (Unreachable, Refused, PeerFault, DamagedData) as problem:
            _log.debug("the log of scene %08x is not had from %s: %s", public.scene, address_of(node), problem)
            return False
