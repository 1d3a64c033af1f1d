"""What a scene does about its log at a node that runs it (specs/16-scene-log.md, On nodes).

What is decided becomes the scene's newest header, with the votes that show it, and its newest sealed log: in the one transaction in which it is
decided. Older values keep their headers alone. What the scene's mode has to say about values, `modes` says.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from scenefold.base.reasons import RejectReason
from scenefold.consensus import Decide, Judge, Reply, Slot, Value, Vote
from scenefold.consensus.facts import true_facts
from scenefold.peer.logs import Owner
from scenefold.peer.records.verification import KnownScene
from scenefold.peer.scene_log.scene_judge import SceneJudge, participants_after
from scenefold.scene.log import decided_by_votes, opened_value, without_log
from scenefold.store.logs import Beside
from scenefold.wire import Phase, ProposalId

Heard = Callable[[KnownScene, Decide], None]
"""What becomes of a scene with its newest header, and by whose votes that was decided."""


class SceneOwner(Owner):
    """Of one scene. `known`: with the newest header that is decided here. `may_speak`: whether this disk is known to be no older one."""

    def __init__(self, known: KnownScene, heard: Heard, modes: Owner | None = None, may_speak: Callable[[], bool] = lambda: True) -> None:
        self.known = known
        self.lacks_log = False
        """The newest position was learnt without its sealed log."""
        self.modes = modes or Owner()
        self._heard, self._may_speak = heard, may_speak
        self._next, self._next_lacks_log = known, False

    def veto(self, value: Value | None) -> RejectReason | None:
        return self.modes.veto(value)

    def insisted(self, value: Value) -> None:
        self.modes.insisted(value)

    def speaks(self) -> bool:
        return self._may_speak()

    def abstains(self, value: Value) -> bool:
        return self.modes.abstains(value)

    def votes(self, value: Value) -> None:
        self.modes.votes(value)

    def stands(self, slot: Slot, *, is_silent: bool) -> None:
        self.modes.stands(slot, is_silent=is_silent)

    def settled(self, reply: Reply) -> None:
        self.modes.settled(reply)

    def leaner(self, value: Value) -> Value:
        return without_log(value)

    def beside(self, decided: Decide, after: Judge) -> Beside:
        assert isinstance(after, SceneJudge)
        before, proof = self.known.public, decided.certificate
        body = opened_value(decided.value)
        # Whoever showed it may have put in votes of his own making beside those that count.
        phase = ProposalId(proof.position, proof.ballot, Phase.ACCEPT)
        true = true_facts(proof.votes, phase, decided.value.digest, before.genesis, participants_after(before))
        public = decided_by_votes(body.public, before, proof.ballot, (fact for fact in true if isinstance(fact, Vote)))
        self._next = replace(after.known, public=public)
        self._next_lacks_log = not body.private
        return Beside({public.scene: public.encode()}, {public.scene: body.private} if body.private else {})

    def decided(self, decided: Decide, after: Judge) -> None:
        self.known, self.lacks_log = self._next, self._next_lacks_log
        self._heard(self.known, decided)
        self.modes.decided(decided, after)

    def begins_at(self, known: KnownScene) -> None:
        """The log goes on behind this header, which was learnt otherwise."""
        self.known = self._next = known
        self.lacks_log = True
