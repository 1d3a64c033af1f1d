"""The workload `logs` in a run: a scene with participants, clients that change its log, and at the end the judge (specs/17-simulation.md, Logs)."""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable, Iterable, Sequence

import trio

from scenefold.simulation import laws
from scenefold.simulation.clients import Client, secrets_of
from scenefold.simulation.cluster import Cluster, key_of
from scenefold.simulation.log_editing import Author, Director, Viewer
from scenefold.simulation.log_history import Told, Wrong, wrong_answers
from scenefold.simulation.log_members import Steward
from scenefold.simulation.log_modes import ModesWatch
from scenefold.simulation.log_observing import ObserverSteward, OwnRenders
from scenefold.simulation.log_watch import LogWatch
from scenefold.simulation.log_weather import first_deciders
from scenefold.simulation.log_work import LogClient, Work
from scenefold.simulation.outcome import COMMITTED_MIN, EDITS_MIN, LOOKS_MIN, Order, Proposals
from scenefold.simulation.workload import draw_places
from scenefold.store.layout import LOGS
from scenefold.store.log_rows import unpack_votes, votes_key

CALM_S_MAX = 90.0
"""Takeovers, and asking others for what is lacking, take some ten seconds each."""
LAST_TRIES = 3
EDITED_PLACES = 6
"""So few, that all of them are read for each image."""
AUTHORS = 2
"""Of the clients so many edit; the others render."""


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
        self._tasks: list[Callable[[trio.Event], Awaitable[None]]] = []
        self._modes: ModesWatch | None = None

    @property
    def proposals(self) -> Proposals:
        """What became of what clients asked for, and of what others had to bring to an end."""
        told = self.watch.history.outcomes()
        at = self.watch.agreement.at
        refused = sum(outcome in (Told.REFUSED, Told.NEVER) for request, outcome in told.items() if request not in at)
        committed = sum(outcome is Told.COMMITTED or request in at for request, outcome in told.items())
        counts = committed, refused, self.watch.voting.taken_over
        if self._modes is None:
            return Proposals(*counts)
        frozen, recorder = self._modes.frozen, self._cluster.watch.recorder
        return Proposals(*counts, len(frozen.switches), len(frozen.edits), recorder.late, frozen.looks)

    @property
    def is_enough(self) -> bool:
        """Whether there is something to judge."""
        done = self.proposals
        return done.committed >= COMMITTED_MIN and done.edits >= EDITS_MIN and done.looks >= LOOKS_MIN

    async def begin(self, clients: Sequence[Client], nonsense: Callable[[Client], Callable[[], int]]) -> None:
        """The scene is there: from now on its log is looked at, and it gets its participants."""
        scenes = [(client, client.scene) for client in clients if client.scene is not None]
        self._clients = [LogClient(client.name, scene, self._order.seed, self._work, nonsense(client)) for client, scene in scenes]
        self._tasks += [client.run for client in self._clients]
        scene = scenes[0][1]
        modes = self._modes = ModesWatch(self._cluster, scene.id, self._judge)
        self.watch.on_decided = modes.decided
        self._cluster.lookers += [self.watch.committed, modes.committed]
        self.watch.follow((await scene.access.read_log()).header)
        nodes, count = self._order.nodes, self._order.deciders
        if count:
            steward = LogClient("steward", scene, self._order.seed, self._work, nonsense(clients[0]))
            watcher = LogClient("observers' steward", scene, self._order.seed, self._work, nonsense(clients[0]))
            able = range(nodes)
            observers = ObserverSteward(self._cluster, watcher, self._order.seed, able, count)
            members = Steward(self._cluster, steward, self._order.seed, able, count, lambda: observers.observing)
            self._tasks.append(members.run)
            if not await members.found(first_deciders(self._order.seed, nodes, count)):
                self._violated(laws.CONVERGED, "in calm weather a scene gets no participants", ())
            self._tasks.append(observers.run)
        await self._edit(clients, modes, nonsense)

    async def _edit(self, clients: Sequence[Client], modes: ModesWatch, nonsense: Callable[[Client], Callable[[], int]]) -> None:
        """Some will edit, others render, and somebody switches between the two."""
        seed = self._order.seed
        places = random.Random(f"edited/{seed}").sample(draw_places(seed, self._order.nodes).hot, EDITED_PLACES)
        for number, client in enumerate(clients):
            assert client.scene is not None
            # That others decide the scene by now everybody is to know: until it looks a client signs without a lease.
            await client.scene.access.refresh()
            modes.looks_at(client)
            given = client, places, seed, nonsense(client), self._wrong
            self._tasks.append(Author(*given).run if number < AUTHORS else Viewer(*given, modes).run)
            if number == len(clients) - 1:
                self._tasks.append(OwnRenders(self._cluster, *given[:3], modes, *given[3:]).run)
                self._tasks.append(Director(LogClient("director", client.scene, seed, self._work, nonsense(client)), seed, modes).run)

    def start(self, nursery: trio.Nursery, stop: trio.Event) -> None:
        """Everybody begins to work."""
        for task in self._tasks:
            nursery.start_soon(task, stop)

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

    def _judge(self, wrong: Iterable[Wrong], slot: int | None) -> None:
        for law, what in wrong:
            self._violated(law, what, () if slot is None else (slot,))

    def _violated(self, law: str, what: str, slots: tuple[int, ...]) -> None:
        self._cluster.watch.violated(law, what, slots=slots)
