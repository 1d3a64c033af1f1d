"""All that leases of one scene are at one node, and how it hangs together (specs/26-modes.md)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace

from scenefold.base.ids import NodeId
from scenefold.peer.modes.activation import Activation, Switch
from scenefold.peer.modes.granter import Verdict, verdict
from scenefold.peer.modes.holder import Holder
from scenefold.peer.modes.lender import Borrower, Lender
from scenefold.peer.modes.releases import Releases
from scenefold.peer.modes.scene import DecidedScene
from scenefold.wire import Ballot, Member, SceneMode, Vote


@dataclass(frozen=True, slots=True)
class Standing:
    """`speaker`: as whom this node decides the open position; somebody else where it must not say anything."""

    me: Member
    scene: DecidedScene
    speaker: Member
    steady_since: int
    """The position behind which neither the mode nor those who decide were changed, as far as this node knows."""
    ends_leases: bool = False
    """It has voted, durably, for something at the open position that changes the mode, or who takes part."""
    is_switching: bool = False
    """It has voted for a SetMode there, or is about to."""
    holder: Holder = field(default_factory=Holder)
    lender: Lender = field(default_factory=Lender)
    releases: Releases = field(default_factory=Releases)
    activation: Activation = field(default_factory=Activation)

    @classmethod
    def started(
        cls, me: Member, scene: DecidedScene, now: float, *, released: int = 0, was_switched: bool = True, may_have_lent: bool = True
    ) -> Standing:
        """`released`: what this node released, by its disk. `stands` is to follow with what it has voted for.

        `was_switched`: the scene's mode may have changed at any time; False only if it surely never has. `may_have_lent`: likewise, this
        node may have lent something before.
        """
        begun = Activation.started(now, was_switched=was_switched)
        lender = Lender.started(now) if may_have_lent else Lender()
        return cls(me, scene, me, scene.position, lender=lender, releases=Releases(released), activation=begun)

    # -------------------------------------------------------------------------------------------------- own leases

    @property
    def may_ask(self) -> bool:
        return self.me in self.scene.everyone and not self.is_switching and self.releases.allow(self.scene.position)

    def asks(self, nonce: int, now: float) -> Standing:
        """Ask all who decide for a lease of the position that is known; the own GRANT is counted by the same rule."""
        assert self.may_ask
        holder = self.holder.ask(self.scene.position, nonce, self.scene.deciders, now)
        if self.judges(self.me, self.scene.position) is Verdict.GRANT:
            holder = holder.granted(nonce, self.me.node)
        return replace(self, holder=holder)

    def granted(self, nonce: int, by: NodeId) -> Standing:
        """A GRANT came from a node."""
        return replace(self, holder=self.holder.granted(nonce, by))

    def acts_in(self, now: float) -> SceneMode | None:
        """The mode that this node may act by at this moment; None: unknown, and it does nothing."""
        return self.scene.mode if self.holder.lease(now) is not None and self.is_active(now) else None

    def is_active(self, now: float) -> bool:
        """Whether the mode that was decided last is active, as far as this node knows."""
        return self.activation.is_active(self.releases, now)

    # ------------------------------------------------------------------------------------------- leases of others

    def judges(self, asker: Member, have: int) -> Verdict:
        """What to answer who asks for a lease."""
        return verdict(self.scene, self.speaker, asker, have, steady_since=self.steady_since, ends_leases=self.ends_leases)

    def may_lend(self, borrower: Borrower, now: float) -> bool:
        """Participants lend while they may act by themselves."""
        return self.me in self.scene.participants and self.acts_in(now) is not None and self.lender.has_room(borrower, now)

    def lends(self, borrower: Borrower, now: float, *, no_more: bool = False) -> tuple[Standing, float]:
        """And for how long, from when the client asked. `no_more`: than what it has already."""
        assert self.may_lend(borrower, now)
        lease = self.holder.lease(now)
        assert lease is not None
        left = lease.until - now
        if no_more:
            left = min(left, self.lender.left_of(borrower, now))
        return replace(self, lender=self.lender.lend(borrower, left, now)), left

    def given_back(self, borrower: Borrower) -> Standing:
        return replace(self, lender=self.lender.given_back(borrower))

    # ----------------------------------------------------------------------------------------------------- the log

    def abstains(self, *, is_switch: bool, now: float) -> bool:
        """Whether this node must not vote for a value yet."""
        return is_switch and self.lender.is_live(now)

    def votes(self, *, is_switch: bool) -> Standing:
        """This node is about to vote: nobody sees the vote before this."""
        return replace(self, holder=self.holder.dropped(), is_switching=True) if is_switch else self

    def stands(self, accepted: DecidedScene | None, speaker: Member | None = None) -> Standing:
        """What this node has voted for at the open position by now, durably: as what it leaves the scene."""
        is_switch = accepted is not None and self.scene.is_switched_by(accepted)
        ends = accepted is not None and self.scene.ends_leases_with(accepted)
        after = replace(self, ends_leases=ends, is_switching=is_switch, speaker=speaker or self.speaker)
        return replace(after, holder=self.holder.dropped()) if is_switch else after

    def releasing(self, position: int) -> Standing:
        """Whoever only observes uses no lease below this position any more, at which, or before which, there was a SetMode.

        Before it is signed, the release is to be durable, or that position's decision.
        """
        if position <= self.releases.own:
            return self
        return replace(self, holder=self.holder.dropped(), releases=self.releases.release(position))

    def decided(self, after: DecidedScene, digest: bytes, ballot: Ballot, votes: Iterable[Vote], now: float) -> Standing:
        """The next position is decided here, durably. `votes`: of its certificate, true ones in this ballot."""
        before = self.scene
        assert after.position == before.position + 1
        is_steady = not before.is_switched_by(after) and before.participants == after.participants
        steady_since = self.steady_since if is_steady else after.position
        standing = replace(self, scene=after, steady_since=steady_since, ends_leases=False, is_switching=False)
        if before.everyone - after.everyone:
            standing = replace(standing, activation=self.activation.removed(self.releases, now))
        if before.is_switched_by(after):
            switch = Switch(after.position, digest, ballot, before.participants, before.observers)
            activation = standing.activation.switched(switch, now)
            for vote in votes:
                activation = activation.voted(vote)
            standing = replace(standing, activation=activation)
        if before.is_switched_by(after) or self.me not in after.everyone:
            standing = replace(standing, holder=self.holder.dropped())
        return standing

    def jumped(self, after: DecidedScene, now: float, *, was_switched: bool) -> Standing:
        """Positions later, of which this node has learnt the newest alone, durably. `was_switched`: the mode may have changed among them.

        Who may have been removed among them is not known either.
        """
        standing = self.releasing(after.position) if was_switched else self
        known = Activation.started(now, was_switched=True) if was_switched else self.activation.removed(self.releases, now)
        holder = standing.holder if self.me in after.everyone else standing.holder.dropped()
        since = after.position
        return replace(standing, scene=after, steady_since=since, ends_leases=False, is_switching=False, holder=holder, activation=known)

    def voted(self, vote: Vote) -> Standing:
        """Somebody's true vote was seen."""
        return replace(self, activation=self.activation.voted(vote))

    def heard(self, member: Member, position: int) -> Standing:
        """Somebody's true release was seen."""
        return replace(self, releases=self.releases.hear(member, position))

    def release(self, now: float) -> int | None:
        """The position of the newest switch, if this node has decided it, and nothing of before is held or lent here: then it may release it. Or
        that which an observer has released already, as far as nobody was told."""
        if self.me in self.scene.observers and not self.releases.cover(self.me, self.releases.own):
            return self.releases.own
        switch = self.activation.switch
        if switch is None or self.me not in switch.participants | switch.observers:
            return None
        # Who must not speak yet may be a disk that has forgotten what it lent.
        is_clear = self.me in switch.observers or (self.speaker == self.me and not self.lender.is_live(now))
        return switch.position if is_clear and not self.releases.cover(self.me, switch.position) else None
