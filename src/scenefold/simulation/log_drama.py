"""The workload `logs` in a run: a scene with participants, clients that change its log, and at the end the judge (specs/17-simulation.md, Logs)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import trio

from scenefold.simulation import laws
from scenefold.simulation.clients import Client, secrets_of
from scenefold.simulation.cluster import Cluster, Node, key_of
from scenefold.simulation.log_history import Told, wrong_answers
from scenefold.simulation.log_members import Steward
from scenefold.simulation.log_watch import LogWatch
from scenefold.simulation.log_weather import first_deciders, may_decide
from scenefold.simulation.log_work import LogClient, Work
from scenefold.simulation.outcome import Order, Proposals
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import unpack_votes, votes_key
from scenefold.world.sim import Point

CALM_S_MAX = 90.0
"""Takeovers, and asking others for what is lacking, take some ten seconds each."""
LAST_TRIES = 3


class LogDrama:
    """One for a run. Made before the clients begin; `begin` is called once the scene is there."""

    def __init__(self, cluster: Cluster, order: Order) -> None:
        self._cluster, self._order = cluster, order
        disks = {slot: node.disk for slot, node in cluster.nodes.items()}
        ids = {slot: node.node_id for slot, node in cluster.nodes.items()}
        self.watch = LogWatch(disks, ids, cluster.watch.put_back, self._violated, cluster.watch.tell)
        self._wrong: list[str] = []
        self._work = Work(self.watch, lambda: cluster.net.now, self._wrong, secrets_of(key_of(order.seed, "the guest")))
        self._clients: list[LogClient] = []
        self._steward: Steward | None = None

    @property
    def proposals(self) -> Proposals:
        """What became of what clients asked for, and of what others had to bring to an end."""
        told = self.watch.history.outcomes()
        at = self.watch.agreement.at
        refused = sum(outcome in (Told.REFUSED, Told.NEVER) for request, outcome in told.items() if request not in at)
        committed = sum(outcome is Told.COMMITTED or request in at for request, outcome in told.items())
        return Proposals(committed, refused, self.watch.voting.taken_over)

    async def begin(self, clients: Sequence[Client], nursery: trio.Nursery, nonsense: Callable[[Client], Callable[[], int]]) -> None:
        """The scene is there: from now on its log is looked at, and it gets its participants."""
        scenes = [(client, client.scene) for client in clients if client.scene is not None]
        self._clients = [LogClient(client.name, scene, self._order.seed, self._work, nonsense(client)) for client, scene in scenes]
        scene = scenes[0][1]
        for node in self._cluster.nodes.values():
            nursery.start_soon(self._observe, node)
        self.watch.follow((await scene.access.read_log()).header)
        schedule, nodes, count = self._order.schedule, self._order.nodes, self._order.deciders
        if count:
            steward = LogClient("steward", scene, self._order.seed, self._work, nonsense(clients[0]))
            self._steward = Steward(self._cluster, steward, self._order.seed, may_decide(schedule, nodes), count)
            if not await self._steward.found(first_deciders(self._order.seed, schedule, nodes, count)):
                self._violated(laws.CONVERGED, "in calm weather a scene gets no participants", ())

    def start(self, nursery: trio.Nursery, stop: trio.Event) -> None:
        """Everybody begins to work."""
        for client in self._clients:
            nursery.start_soon(client.run, stop)
        if self._steward is not None:
            nursery.start_soon(self._steward.run, stop)

    async def settle(self) -> None:
        """All has healed: everybody comes to one log, and a fresh entry goes in. Then what clients were told is judged."""
        with trio.move_on_after(CALM_S_MAX):
            while self._unrest():  # noqa: ASYNC110 - what it waits for is on disks, which tell nobody
                await trio.sleep(1.0)
        for what, slot in self._unrest():
            self._violated(laws.CONVERGED, what, (slot,))
        await self._last_entry()
        for words in self._wrong:
            self._violated(laws.SOUND, words, ())
        for law, what in wrong_answers(self.watch.history.attempts, self.watch.agreement.at):
            self._violated(law, what, ())

    async def _last_entry(self) -> None:
        """In calm weather; its author reads the whole log, and says where each request is."""
        client = self._clients[0]
        for _ in range(LAST_TRIES):
            read = await client.last()
            if read is not None:
                for request, position in sorted(read.state.requests.items()):
                    self.watch.judge(self.watch.agreement.requested(request, position))
                return
        self._violated(laws.CONVERGED, "in calm weather nobody can bring an entry into the log", ())

    def _unrest(self) -> list[tuple[str, int]]:
        """What keeps the participants' disks from showing one log with nothing open."""
        found, newest = [], self.watch.agreement.newest
        assert self.watch.first is not None
        key = votes_key(self.watch.first.genesis)
        for member in self.watch.participants():
            slot = self._cluster.slot_of(member.node)
            stored = self._cluster.nodes[slot].disk.written(LOGS).get(key)
            votes = None if stored is None else unpack_votes(self.watch.first.genesis, memoryview(stored))
            is_lost = votes is None or votes.incarnation != member.incarnation or self._cluster.nodes[slot].context is None
            if votes is None or is_lost:
                # It lost its disk, or has left, and nobody has replaced it yet.
                continue
            if votes.position != newest + 1:
                found.append((f"n{slot} takes part in the log and knows {votes.position - 1} of {newest} positions", slot))
            elif votes.slot.accepted is not None:
                found.append((f"n{slot} has voted at position {votes.position}, and nobody brings that to an end", slot))
        return found

    async def _observe(self, node: Node) -> None:
        await node.born.wait()
        self._cluster.net.observe(node.address, Point.AFTER_COMMIT, partial(self.watch.committed, node.slot))

    def _violated(self, law: str, what: str, slots: tuple[int, ...]) -> None:
        self._cluster.watch.violated(law, what, slots=slots)
