"""Hostile faults: a network that plays datagrams again and changes them, and members that lie (specs/17-simulation.md, Lies).

The network keeps what was sent lately and sends it again, now and then with a bit turned over, to whom it was for. A liar is a
node like all others, but for its words: wrong answers, false statuses, and pieces of the line that it does not hand over as they are.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Mapping, Sequence
from functools import partial

import trio

from scenefold.base.location import Arc
from scenefold.crypto import SigningKey
from scenefold.peer import NodeContext
from scenefold.simulation import laws
from scenefold.simulation.clients import Client
from scenefold.simulation.cluster import Cluster, Node
from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.liar import Liar, MadeUp, Scope, flipped, scopes_of
from scenefold.simulation.lying_answers import LyingAnswers
from scenefold.simulation.lying_bounds import LyingBounds
from scenefold.simulation.lying_copies import LyingCopies
from scenefold.simulation.lying_handovers import LyingHandovers
from scenefold.simulation.lying_judge import LyingJudge
from scenefold.simulation.lying_lives import LyingLives
from scenefold.simulation.lying_words import FAR, LyingWords

FLIPPED = 0.3
"""Share of the datagrams that are played again with a bit turned over."""
LOOK_S = 0.2
INTRUDE_S = 0.5
"""Between two records that a liar makes up and brings home, or offers again; it looks as often whether its node runs anew."""


class HostileFaults:
    """The network and liars at work. `clients`: whose keys a reader has betrayed to the liars."""

    def __init__(
        self,
        cluster: Cluster,
        begins: Callable[[Fault], None],
        ends: Callable[[Fault], None],
        is_over: Callable[[], bool],
        clients: Sequence[Client] = (),
    ) -> None:
        self._cluster = cluster
        self._begins, self._ends, self._is_over = begins, ends, is_over
        self._clients = clients
        self._dice = random.Random(f"hostile/{cluster.net.seed}")
        self._made_up = MadeUp()
        self._liars: dict[int, _Possession] = {}
        self._complained: set[tuple[int, str]] = set()

    def lies_in_wait(self, fault: Fault) -> None:
        """What is played again was sent before the fault begins."""
        if fault.kind is Kind.REPLAY:
            self._cluster.net.keep_datagrams()

    async def befall(self, fault: Fault) -> None:
        if fault.kind is Kind.REPLAY:
            await self._replay(fault)
        else:
            await self._lie(fault)

    async def _replay(self, fault: Fault) -> None:
        net, has_begun = self._cluster.net, False
        while net.now < fault.end_s and not self._is_over():
            flip = self._dice.random() < FLIPPED
            net.play_again(self._dice, self._flipped if flip else None)
            if not has_begun and net.counts["played again"]:
                # Once something was kept there always is something.
                has_begun = True
                self._begins(fault)
            await trio.sleep(1 / fault.amount)
        if has_begun:
            self._ends(fault)

    async def _lie(self, fault: Fault) -> None:
        possession = self._possession(fault.slots[0])
        scopes = (Scope.COPIES,) if fault.kind is Kind.LYING_HOLDER else scopes_of(fault.amount)
        told, before, has_begun = self._cluster.watch.recorder.lies.told, self._cluster.watch.recorder.lies.told.total(), False
        possession.liar.at_work += scopes
        try:
            while self._cluster.net.now < fault.end_s and not self._is_over():
                # It lies on after a restart.
                possession.possess()
                await trio.sleep(INTRUDE_S if {Scope.HANDOVERS, Scope.ACKNOWLEDGEMENTS, Scope.COPIES} & set(scopes) else LOOK_S)
                if Scope.HANDOVERS in scopes:
                    await possession.handovers.intrude()
                    await possession.bounds.offer_others()
                if Scope.ACKNOWLEDGEMENTS in scopes:
                    await possession.judge.offer_again()
                if Scope.STATUSES in scopes:
                    await possession.lives.flood()
                if Scope.COPIES in scopes:
                    await possession.copies.intrude()
                self._look_for_believers()
                if not has_begun and told.total() > before:
                    has_begun = True
                    self._begins(fault)
        finally:
            for scope in scopes:
                possession.liar.at_work.remove(scope)
        if has_begun:
            self._ends(fault)

    def _possession(self, slot: int) -> _Possession:
        if slot not in self._liars:
            watch = self._cluster.watch
            node, lies, seed = self._cluster.nodes[slot], watch.recorder.lies, self._cluster.net.seed
            liar = Liar(node, lies, self._made_up, self._keys, self._owner, seed)
            judge = LyingJudge(liar, watch.recorder)
            handovers = LyingHandovers(liar, watch, partial(self._lies_in, Scope.HANDOVERS))
            copies = LyingCopies(liar, watch, partial(self._lies_in, Scope.COPIES), partial(self._has_word_of, node))
            bounds, lives = LyingBounds(liar, self._cluster), LyingLives(liar, self._cluster)
            self._liars[slot] = _Possession(liar, judge, LyingAnswers(liar, judge), handovers, bounds, lives, LyingWords(liar), copies)
        return self._liars[slot]

    def _lies_in(self, scope: Scope, node_id: int) -> bool:
        liars = (possession.liar for possession in self._liars.values())
        return any(liar.node.node_id == node_id and liar.lies_in(scope) for liar in liars)

    def _has_word_of(self, owner: Node, node_id: int, arc: Arc) -> bool:
        """Whether a node believes of another, by that one's own word, that it owns an arc."""
        context = self._cluster.nodes[self._cluster.slot_of(node_id)].context
        claimed = None if context is None else context.roster.arcs().get(owner.node_id)
        return claimed is not None and claimed.first <= arc.first and arc.last <= claimed.last

    def _keys(self) -> Mapping[int, bytes]:
        scene = next((client.scene for client in self._clients if client.scene is not None), None)
        return {} if scene is None else scene.access.identity.keys

    def _owner(self) -> SigningKey | None:
        """What an owner signs headers with."""
        logs = (client.scene.access.log for client in self._clients if client.scene is not None)
        seed = next((log.keys.header_seed for log in logs if log is not None), None)
        return None if seed is None else SigningKey(seed)

    def _look_for_believers(self) -> None:
        """Nobody believes what a liar made up in the name of others."""
        for slot, node in self._cluster.running.items():
            context = node.context
            if context is None:
                continue
            for status in context.roster.statuses():
                if (by := self._made_up.statuses.get(status, slot)) != slot:
                    self._complain(slot, by, f"of n{self._cluster.slot_of(status.node)}")
            for header in context.scenes.all():
                if (by := self._made_up.headers.get(header, slot)) != slot:
                    self._complain(slot, by, "of a scene's header")
        for client in self._clients:
            if client.scene is not None and client.scene.access.identity.position >= FAR:
                self._cluster.watch.violated(laws.VERIFIED, f"{client.name} believes a header that was made up")

    def _complain(self, slot: int, by: int, what: str) -> None:
        if (slot, what) not in self._complained:
            self._complained.add((slot, what))
            self._cluster.watch.violated(laws.VERIFIED, f"n{slot} believes what n{by} made up {what}", slots=(slot, by))

    def _flipped(self, data: bytes) -> bytes:
        return flipped(data, self._dice)


class _Possession:
    """A liar's mouths, put on each life of its node once."""

    def __init__(
        self,
        liar: Liar,
        judge: LyingJudge,
        answers: LyingAnswers,
        handovers: LyingHandovers,
        bounds: LyingBounds,
        lives: LyingLives,
        words: LyingWords,
        copies: LyingCopies,
    ) -> None:
        self.liar = liar
        self.judge = judge
        self.handovers = handovers
        self.bounds = bounds
        self.lives = lives
        self.copies = copies
        self._mouths = judge, answers, handovers, bounds, lives, words, copies
        self._possessed: NodeContext | None = None

    def possess(self) -> None:
        context = self.liar.node.context
        if context is None or context is self._possessed:
            return
        self._possessed = context
        for mouth in self._mouths:
            mouth.possess(context)
