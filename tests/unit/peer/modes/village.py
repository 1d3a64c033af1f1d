"""Nodes and clients of one scene, their clocks, what is on its way between them, and a log that is decided among them.

Of consensus there is what leases go by: promises, votes in ballots of whatever order, decisions that somebody learns when he does.
What nodes say of leases is the real thing (`Standing`). Time is that of the world; each has a clock of his own, which runs a little wrong.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, field, replace
from random import Random

from scenefold.base.ids import KeyId, NodeId
from scenefold.peer.modes import Borrower, DecidedScene, Standing, Verdict, activation
from scenefold.wire import Ballot, Member, SceneMode, Vote

RHO = 0.01
NO_BALLOT = Ballot(0, NodeId(0))


class Broken(AssertionError):
    """I7 does not hold."""


@dataclass(frozen=True)
class Clock:
    rate: float
    offset: float

    def at(self, time: float) -> float:
        return self.offset + self.rate * time

    def time_of(self, moment: float) -> float:
        """When, in the world's time, this clock shows so much."""
        return (moment - self.offset) / self.rate


@dataclass(frozen=True)
class Value:
    """A SetMode, the removal of somebody, an observer that comes to decide, or something else."""

    number: int
    switches: bool = False
    leaves: Member | None = None
    joins: Member | None = None

    @property
    def digest(self) -> bytes:
        return self.number.to_bytes(32, "big")

    def after(self, scene: DecidedScene) -> DecidedScene:
        mode = SceneMode(1 - scene.mode) if self.switches else scene.mode
        gone = frozenset() if self.leaves is None else frozenset({self.leaves})
        new = frozenset() if self.joins is None else frozenset({self.joins})
        return DecidedScene(scene.position + 1, mode, scene.participants - gone | new, scene.observers - gone - new)


@dataclass
class Position:
    """One that is being decided, by those of `scene`."""

    scene: DecidedScene
    values: dict[Ballot, Value] = field(default_factory=dict)
    votes: list[Vote] = field(default_factory=list)
    chosen: Value | None = None
    proof: Ballot | None = None
    """The first ballot in which it was chosen."""

    def voters(self, ballot: Ballot) -> frozenset[Member]:
        return frozenset(vote.member for vote in self.votes if vote.ballot == ballot)


@dataclass
class Node:
    member: Member
    clock: Clock
    scene: DecidedScene
    standing: Standing | None
    """None while it is down."""
    promised: Ballot = NO_BALLOT
    accepted: tuple[Ballot, Value] | None = None
    released: int = 0
    written: Standing | None = None
    """What it was when it last was granted a lease: for a mutant that keeps that on its disk."""
    was_switched: bool = False


@dataclass
class Client:
    """It borrows from any participant, uses what it has, and gives it back."""

    clock: Clock
    process: int = 0
    asked: dict[int, tuple[float, Member]] = field(default_factory=dict)
    position: int = 0
    until: float = 0.0
    lender: Member | None = None

    def borrower(self, number: int) -> Borrower:
        return Borrower(KeyId(number), self.process.to_bytes(16, "big"))


class Village:
    """`nodes` take part from the beginning, `observers` hold keys."""

    # Mutants: what a start does wrong.
    keeps_leases = False
    forgets_releases = False
    forgets_lent = False

    def __init__(self, seed: int, nodes: int, observers: int = 1, clients: int = 2) -> None:
        self.random = Random(seed)
        self.time = 0.0
        members = [Member(NodeId(number), bytes(16)) for number in range(1, nodes + observers + 1)]
        self.first = DecidedScene(1, SceneMode.EDIT, frozenset(members[:nodes]), frozenset(members[nodes:]))
        self.positions = {2: Position(self.first)}
        self.nodes = {member: Node(member, self._clock(), self.first, None) for member in members}
        self.clients = [Client(self._clock()) for _ in range(clients)]
        self.mail: list[Callable[[], None]] = []
        self.said: list[tuple[Member, int]] = []
        """All releases that were ever signed."""
        self.numbers = 0
        for member in members:
            self.start(member)

    def _clock(self) -> Clock:
        return Clock(1 + RHO * self.random.choice([-1, 1, self.random.uniform(-1, 1)]), self.random.uniform(0, 1000))

    def number(self) -> int:
        self.numbers += 1
        return self.numbers

    # ------------------------------------------------------------------------------------------------------ nodes

    def up(self, member: Member) -> bool:
        return self.nodes[member].standing is not None

    def now(self, member: Member) -> float:
        return self.nodes[member].clock.at(self.time)

    def standing(self, member: Member) -> Standing:
        known = self.nodes[member].standing
        assert known is not None
        return known

    def start(self, member: Member) -> None:
        node = self.nodes[member]
        released = 0 if self.forgets_releases else node.released
        was_switched = node.scene.position > 1
        standing = Standing.started(member, node.scene, self.now(member), released=released, was_switched=was_switched)
        if self.keeps_leases and node.written is not None:
            standing = replace(standing, holder=node.written.holder)
        if self.forgets_lent:
            standing = replace(standing, lender=type(standing.lender)())
        node.standing = standing.stands(None if node.accepted is None else node.accepted[1].after(node.scene))

    def crash(self, member: Member) -> None:
        self.nodes[member].standing = None

    def ask(self, member: Member) -> bool:
        """For a lease, of everybody who decides."""
        node = self.nodes[member]
        if node.standing is None or not node.standing.may_ask:
            return False
        nonce, have = self.number(), node.scene.position
        node.standing = node.standing.asks(nonce, self.now(member))
        for other in node.scene.participants - {member}:
            self.mail.append(lambda other=other: self._asked(other, member, nonce, have))  # type: ignore[misc]
        return True

    def _asked(self, member: Member, asker: Member, nonce: int, have: int) -> None:
        if self.up(member) and self.standing(member).judges(asker, have) is Verdict.GRANT:
            self.mail.append(lambda: self._granted(asker, nonce, member))

    def _granted(self, member: Member, nonce: int, by: Member) -> None:
        if self.up(member):
            node = self.nodes[member]
            node.standing = node.written = self.standing(member).granted(nonce, by.node)

    # ---------------------------------------------------------------------------------------------------- the log

    def open_ballot(self, position: int, promising: Collection[Member], ballot: Ballot, wish: Value) -> bool:
        """A majority promises; the value is that of the highest ballot that one of them has voted in."""
        at = self.positions[position]
        nodes = [self.nodes[member] for member in promising]
        if ballot in at.values or any(node.standing is None or node.scene is not at.scene or node.promised > ballot for node in nodes):
            return False
        assert len(nodes) > len(at.scene.participants) // 2
        for node in nodes:
            node.promised = ballot
        held = [node.accepted for node in nodes if node.accepted is not None]
        at.values[ballot] = max(held, key=lambda accepted: accepted[0])[1] if held else wish
        return True

    def ballots(self, member: Member) -> list[Ballot]:
        """Those in which somebody may vote, by rising order."""
        node = self.nodes[member]
        at = self.positions.get(node.scene.position + 1)
        if at is None or node.standing is None or member not in at.scene.participants:
            return []
        return sorted(ballot for ballot in at.values if ballot >= node.promised and member not in at.voters(ballot))

    def vote(self, member: Member, ballot: Ballot) -> bool:
        node, at = self.nodes[member], self.positions[self.nodes[member].scene.position + 1]
        value = at.values[ballot]
        assert node.standing is not None
        if node.standing.abstains(is_switch=value.switches, now=self.now(member)):
            return False
        node.standing = node.standing.votes(is_switch=value.switches)
        node.promised, node.accepted = ballot, (ballot, value)
        node.standing = node.standing.stands(value.after(node.scene))
        at.votes.append(Vote(node.scene.position + 1, ballot, value.digest, member))
        if at.chosen is None and len(at.voters(ballot)) > len(at.scene.participants) // 2:
            at.chosen, at.proof = value, ballot
            self.positions[node.scene.position + 2] = Position(value.after(at.scene))
        return True

    def learn(self, member: Member) -> bool:
        """The next position, with a certificate of more or fewer of the votes."""
        node = self.nodes[member]
        at = self.positions.get(node.scene.position + 1)
        if at is None or at.chosen is None or at.proof is None or node.standing is None:
            return False
        votes = [vote for vote in at.votes if vote.ballot == at.proof]
        few = self.random.sample(votes, len(at.scene.participants) // 2 + 1)
        value, before = at.chosen, node.scene
        node.scene = self.positions[before.position + 2].scene
        node.promised, node.accepted = NO_BALLOT, None
        certificate = self.random.choice([few, votes])
        node.standing = node.standing.decided(node.scene, value.digest, at.proof, certificate, self.now(member))
        node.was_switched |= value.switches
        return True

    def show_votes(self, member: Member, *, all_of_them: bool = False) -> bool:
        """Votes that somebody else saw; an observer that is shown one for a switch releases, and whoever has decided it may."""
        if not self.up(member):
            return False
        standing = self.standing(member)
        for at in self.positions.values():
            for vote in at.votes if all_of_them else self.random.sample(at.votes, self.random.randrange(len(at.votes) + 1)):
                is_next = vote.position == standing.scene.position + 1
                if member in standing.scene.observers and is_next and at.values[vote.ballot].switches:
                    standing = standing.releasing(vote.position)
                standing = standing.voted(vote)
        if standing.releases.own > self.nodes[member].released:
            self.nodes[member].released = standing.releases.own
            self.said.append((member, standing.releases.own))
        self.nodes[member].standing = standing
        return True

    def release(self, member: Member) -> bool:
        if not self.up(member):
            return False
        position = self.standing(member).release(self.now(member))
        if position is None:
            return False
        self.said.append((member, position))
        self.nodes[member].standing = self.standing(member).heard(member, position)
        return True

    def hear(self, member: Member, *, all_of_them: bool = False) -> bool:
        """Releases that were signed."""
        if not self.up(member) or not self.said:
            return False
        for who, position in self.said if all_of_them else self.random.sample(self.said, self.random.randrange(1, len(self.said) + 1)):
            self.nodes[member].standing = self.standing(member).heard(who, position)
        return True

    # ---------------------------------------------------------------------------------------------------- clients

    def borrow(self, number: int, lender: Member) -> bool:
        client, nonce = self.clients[number], self.number()
        client.asked = {nonce: (client.clock.at(self.time), lender)}
        self.mail.append(lambda: self._lend(number, lender, client.borrower(number), nonce))
        return True

    def _lend(self, number: int, member: Member, borrower: Borrower, nonce: int) -> None:
        if not self.up(member) or not self.standing(member).may_lend(borrower, self.now(member)):
            return
        after, left = self.standing(member).lends(borrower, self.now(member))
        self.nodes[member].standing = after
        position = self.nodes[member].scene.position
        self.mail.append(lambda: self._lent(number, nonce, position, left))

    def _lent(self, number: int, nonce: int, position: int, left: float) -> None:
        client = self.clients[number]
        if nonce in client.asked:
            asked_at, client.lender = client.asked.pop(nonce)
            client.position, client.until = position, asked_at + left

    def give_back(self, number: int) -> bool:
        client = self.clients[number]
        client.asked.clear()
        client.until = 0.0
        lender = client.lender
        if lender is None:
            return False
        borrower = client.borrower(number)
        client.lender = None

        def given() -> None:
            if self.up(lender):
                self.nodes[lender].standing = self.standing(lender).given_back(borrower)

        self.mail.append(given)
        return True

    def begin_anew(self, number: int) -> bool:
        """The client's process ends, and another one begins."""
        self.clients[number] = Client(self.clients[number].clock, self.clients[number].process + 1)
        return True

    # ---------------------------------------------------------------------------------------------------- judging

    def leases(self) -> Iterable[tuple[int, float]]:
        """The position of each lease that can be used now, and until when, by the world's time."""
        for node in self.nodes.values():
            lease = None if node.standing is None else node.standing.holder.lease(node.clock.at(self.time))
            if lease is not None:
                yield lease.position, node.clock.time_of(lease.until)
        for client in self.clients:
            if client.clock.at(self.time) < client.until:
                yield client.position, client.clock.time_of(client.until)

    def acting(self) -> int:
        """The highest position of a switch that somebody holds for active."""
        return max((self._switch_of(node) for node in self.nodes.values()), default=0)

    def _switch_of(self, node: Node) -> int:
        if node.standing is None or not node.standing.is_active(node.clock.at(self.time)):
            return 0
        decided = [at for at in range(2, node.scene.position + 1) if self._is_switch(at)]
        return decided[-1] if decided else 0

    def _is_switch(self, position: int) -> bool:
        chosen = self.positions[position].chosen
        return chosen is not None and chosen.switches

    def judge(self) -> None:
        """I7: nobody can use a lease of before a switch that somebody acts by."""
        switch = self.acting()
        old = [position for position, _ in self.leases() if position < switch]
        if old:
            raise Broken(f"I7: at {self.time:.3f} the switch of position {switch} is active, and leases of {old} can be used")

    def let_pass(self, seconds: float) -> None:
        """Time goes on, from one moment at which something may change to the next; judged at each."""
        end = self.time + seconds
        moments = [until for _, until in self.leases()]
        for node in self.nodes.values():
            if node.standing is not None:
                known = node.standing.activation
                starts = (known.learnt_at, known.removed_at)
                moments += [node.clock.time_of(start + activation.T_WAIT_S) for start in starts if start > float("-inf")]
        for moment in sorted(moments):
            # A little before and behind it: clocks are floats.
            for at in (moment - 1e-6, moment + 1e-6):
                if self.time < at < end:
                    self.time = at
                    self.judge()
        self.time = end
        self.judge()
