"""One event under consideration: what has become of the state so far, and what is to be done.

A case lives as long as one step is computed, and nobody keeps it. Whatever was changed durably in the course of it becomes one
write at the end, in front of all that shows it: so rule D (specs/25-consensus.md, What is durable) cannot be broken by the
order in which actions are named in a table.
"""

from __future__ import annotations

from dataclasses import replace

from scenefold.base.ids import NodeId
from scenefold.base.reasons import RejectReason
from scenefold.consensus.certificates import Certificate
from scenefold.consensus.effects import Decide, Effect, Outcome, Persist, Reply, Send, SetTimer, Step
from scenefold.consensus.events import View
from scenefold.consensus.facts import AnyFact, Promise, Vote, signed
from scenefold.consensus.messages import AskLog, Learn, Message
from scenefold.consensus.participants import Participants
from scenefold.consensus.routes import in_line
from scenefold.consensus.slots import Slot
from scenefold.consensus.state import NEVER, Proposal, Setting, State
from scenefold.consensus.timing import Timer, Waits
from scenefold.consensus.values import Value
from scenefold.wire import Ballot


class Case:
    """`state` is the state so far; `before` what it was when the event happened."""

    def __init__(self, setting: Setting, state: State, view: View) -> None:
        self.setting, self.before, self.state, self.view = setting, state, state, view
        self.effects: list[Effect] = []
        self.decided: Decide | None = None

    # ------------------------------------------------------------------------------------------------- questions

    @property
    def me(self) -> NodeId:
        return self.setting.me.node

    @property
    def open_position(self) -> int:
        return self.state.position + 1

    @property
    def participants(self) -> Participants:
        """Who decides the open position."""
        return self.state.judge.participants

    @property
    def takes_part(self) -> bool:
        return self.setting.me in self.participants

    @property
    def reaches_majority(self) -> bool:
        """Whether a majority of P(L) can be reached, as far as this node knows, itself counted."""
        return len(self.participants.nodes & (self.view.reachable | {self.me})) >= self.participants.majority

    @property
    def slot(self) -> Slot:
        return self.state.slot

    @property
    def proposal(self) -> Proposal:
        return self.state.proposal

    # --------------------------------------------------------------------------------------------------- changes

    def change_slot(self, slot: Slot) -> None:
        self.state = replace(self.state, slot=slot)

    def change_proposal(self, proposal: Proposal) -> None:
        self.state = replace(self.state, proposal=proposal)

    def count_try(self) -> int:
        """One more ballot for the open position came to nothing; how many have."""
        self.state = replace(self.state, tries=self.state.tries + 1)
        return self.state.tries

    def promise(self, ballot: Ballot) -> Promise:
        """Promise a ballot, and say so."""
        accepted, digest = self.slot.accepted_ballot, self.slot.accepted_digest
        self.change_slot(self.slot.promise(ballot))
        return self._sign(Promise(self.open_position, ballot, accepted, digest, self.setting.me))

    def vote(self, ballot: Ballot, value: Value) -> Vote:
        """Vote for a value, and say so."""
        self.change_slot(self.slot.vote(ballot, value))
        return self._sign(Vote(self.open_position, ballot, value.digest, self.setting.me))

    def _sign(self, fact: AnyFact) -> AnyFact:
        return signed(fact, self.setting.genesis, self.setting.key)

    def hear(self) -> None:
        """Somebody goes on with the open position, so that nobody need take it over yet."""
        self.state = replace(self.state, heard_at=self.view.now)
        self.watch()

    def watch(self) -> None:
        """Take over what this node has voted for, unless more is heard of it."""
        if self.slot.accepted is not None and self.takes_part:
            least, most = self.setting.timing.orphan_s(len(self.participants.everyone), self.rank())
            self.set_timer(Timer(Waits.ORPHAN), least, most)

    def lose_link(self, node: NodeId) -> None:
        """Whoever began what this node has voted for may be dead: nobody is held up for it any more, and this node takes over in its turn."""
        accepted = self.slot.accepted
        if accepted is not None and accepted.ballot.node == node and self.takes_part:
            self.state = replace(self.state, orphaned=accepted.ballot)
            least, base = self.rank() * self.setting.timing.base_s, self.setting.timing.base_s
            self.set_timer(Timer(Waits.ORPHAN), least, least + base)

    def find_link(self) -> None:
        """Whoever began what this node has voted for lives after all."""
        self.state = replace(self.state, orphaned=None)

    def rank(self) -> int:
        """This node's place among the participants, in the order of the line."""
        return in_line(self.participants.nodes, self.view.line).index(self.me)

    def decide(self, value: Value, certificate: Certificate) -> None:
        """The open position is decided; the next one is open. Whoever had asked here, and was told that it is unknown, hears of it."""
        assert self.decided is None and certificate.position == self.open_position, "one position after the other"
        accepted = self.slot.accepted
        if accepted is not None and accepted.value == value:
            # What was voted for is whole. Of what somebody tells parts of the body may be missing, and they may be nowhere else.
            value = accepted.value
        self.decided = Decide(self.open_position, value, certificate)
        for digest in sorted(self.slot.exposed):
            if digest != self.proposal.digest or not self.proposal.is_asked:
                is_it = digest == value.digest
                reason = None if is_it else RejectReason.POSITION_BEHIND
                self.do(Reply(digest, Outcome.COMMITTED if is_it else Outcome.REJECTED, self.open_position, reason))
        position, judge = self.open_position, self.state.judge.after(value)
        # Their values are known now, to whoever has a use for them.
        hops = tuple(replace(hop, value=None) if hop.proposal.position <= position else hop for hop in self.state.hops)
        self.state = replace(self.state, judge=judge, position=position, slot=Slot(), tries=0, hops=hops, heard_at=NEVER, orphaned=None)

    def tell_everybody(self) -> None:
        """All who took part in what was decided, and all who take part in what comes next."""
        assert self.decided is not None
        done = self.decided
        everybody = self.before.judge.participants.nodes | self.participants.nodes
        voted = {vote.member.node for vote in done.certificate.votes}
        for node in in_line(everybody - {self.me}, self.view.line):
            # Whoever has voted for it has its bytes.
            value = Value(done.value.data) if node in voted else done.value
            self.send(node, Learn(self.setting.genesis, done.position, value, done.certificate))

    # --------------------------------------------------------------------------------------------------- effects

    def do(self, effect: Effect) -> None:
        self.effects.append(effect)

    def send(self, target: NodeId, message: Message) -> None:
        self.do(Send(target, message))

    def set_timer(self, timer: Timer, least_s: float, most_s: float) -> None:
        self.do(SetTimer(timer, least_s, most_s))

    def ask_log(self, target: NodeId) -> None:
        """Ask for what is decided above c, unless that was asked a moment ago: participants, or others, who keep nobody from asking those. What comes in the wrong order must not be asked for
        again by each that comes too early: with a disk that refuses the first, that would never end."""
        is_known = target in self.participants.nodes
        asked_at = self.state.asked_at if is_known else self.state.asked_others_at
        if self.view.now - asked_at >= self.setting.timing.pass_s_min:
            now = self.view.now
            self.state = replace(self.state, asked_at=now) if is_known else replace(self.state, asked_others_at=now)
            self.send(target, AskLog(self.setting.genesis, self.state.position))

    def step(self) -> Step[State]:
        """What has come of it: the write, if anything durable was changed, and then all else."""
        write: tuple[Effect, ...] = ()
        if self.decided is not None:
            assert self.slot == Slot(), "nothing is begun in the step that decides"
            write = (self.decided,)
        elif self.slot != self.before.slot:
            write = (Persist(self.slot),)
        assert not write or self.view.can_write, "who cannot write changes nothing"
        return Step(self.state, (*write, *self.effects))
