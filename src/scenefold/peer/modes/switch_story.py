"""What a node hears, and tells, of the newest change of a scene's mode: who voted for it, and who released it (specs/26-modes.md, The switch)."""

from __future__ import annotations

import logging
from collections.abc import Iterable
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId
from scenefold.consensus import Certificate, Decide, Participants, Value, Vote
from scenefold.consensus.facts import Fact, true_facts
from scenefold.crypto import PublicKey
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.modes.packets import said_in
from scenefold.peer.modes.scene import DecidedScene
from scenefold.peer.peers import Peers
from scenefold.peer.scene_log.scene_judge import participants_after
from scenefold.peer.timing import LEASE_ASK_S_MAX
from scenefold.wire import (
    DecidedLog,
    DecidedValue,
    LogValue,
    Member,
    Packet,
    ParticipantEntry,
    Phase,
    ProposalId,
    Release,
    RespondSceneLog,
    SceneLogPublic,
)
from scenefold.world import Priority, World

if TYPE_CHECKING:
    from scenefold.peer.modes.scene_modes import SceneModes

SAID_TIMES = 3
"""What a node says of a switch is sent so often: it may be lost, and who does not hear it waits T_WAIT."""
SAID_PAUSE_S = 2.0

_log = logging.getLogger("scenefold.peer.modes")


class SwitchStory:
    """`before`: the header of before the switch."""

    def __init__(self, modes: SceneModes, world: World, peers: Peers, own: OwnStatus, before: SceneLogPublic) -> None:
        self._modes, self._world, self._peers, self._own = modes, world, peers, own
        self.forget(before)

    def forget(self, before: SceneLogPublic) -> None:
        """The scene as this node knows it at a start, or behind positions that it never learnt."""
        self._before = before
        self._switch: Decide | None = None
        self._to_say = 0
        self._released: dict[Member, Release] = {}

    # ------------------------------------------------------------------------------------------------------- facts

    def shown(self, packet: Packet) -> None:
        """Votes and releases in a packet about this log may make the mode active."""
        switch = self._switch
        position, facts, releases = said_in(packet, 0 if switch is None else switch.position)
        for release in releases:
            self._hear(release)
        if switch is not None and position == switch.position and not self._modes.is_active:
            self._count(facts, switch)

    def switched(self, before: SceneLogPublic, decided: Decide) -> None:
        """It is decided here; `modes` knows that by now."""
        # Who was neither there before nor is now has nothing to say, and nobody to say it to.
        is_there = self._own.member in DecidedScene.of(before).everyone
        self._before, self._switch, self._to_say = before, decided, SAID_TIMES if is_there else 0
        for release in self._released.values():
            self._hear(release)

    def released(self, decided: Decide) -> None:
        """This node has released this position, or a later one: those who wait for that are to be told."""
        self._switch, self._to_say = decided, SAID_TIMES

    def true_votes(self, votes: Iterable[Fact], proof: Certificate, value: Value, before: SceneLogPublic) -> list[Vote]:
        """Those of these that are votes for what was decided, and verify."""
        deciders: Participants = participants_after(before)
        proposals = {ProposalId(vote.position, vote.ballot, Phase.ACCEPT) for vote in votes if vote.position == proof.position}
        found = [fact for proposal in proposals for fact in true_facts(votes, proposal, value.digest, before.genesis, deciders)]
        return [fact for fact in found if isinstance(fact, Vote)]

    def _count(self, facts: Iterable[Fact], switch: Decide) -> None:
        modes = self._modes
        seen = modes.standing.activation.voters
        new = [fact for fact in facts if isinstance(fact, Vote) and fact.member not in seen]
        for vote in self.true_votes(new, switch.certificate, switch.value, self._before):
            modes.standing = modes.standing.voted(vote)

    def _hear(self, release: Release) -> None:
        """Of somebody who may hold leases now, or might before the switch."""
        modes = self._modes
        known = self._released.get(release.member)
        if known is not None and known.position >= release.position and modes.standing.releases.cover(release.member, release.position):
            return
        key = key_of(release.member, self._before) or key_of(release.member, modes.public)
        if key is None:
            return
        try:
            key.verify(release.signature, Release.DOMAIN, release.signable(modes.public.genesis))
        except DamagedData:
            return
        self._released[release.member] = release
        modes.standing = modes.standing.heard(release.member, release.position)

    # ------------------------------------------------------------------------------------------------------ saying

    async def run(self) -> None:
        """Until cancelled: say of a switch what may be said."""
        modes = self._modes
        while True:
            await modes.news.until(lambda: self._to_say > 0 and self._switch is not None)
            assert self._switch is not None
            self._release()
            # Its own word is to be among them.
            if modes.standing.releases.cover(self._own.member, self._switch.position):
                await self._say(self._switch)
                self._to_say -= 1
            await self._world.clock.sleep(SAID_PAUSE_S)

    def _release(self) -> None:
        """Sign it as soon as it is true. It stays so: who has decided the switch asks for no lease of before any more, also after a start."""
        position = self._modes.standing.release(self._world.clock.now())
        if position is not None:
            plain = Release(position, self._own.member)
            signature = self._own.key.sign(Release.DOMAIN, plain.signable(self._modes.public.genesis))
            self._hear(Release(position, self._own.member, signature))

    async def _say(self, switch: Decide) -> None:
        """All that is known of who released it, to everybody who waits for that."""
        proof, before, after = switch.certificate, DecidedScene.of(self._before), self._modes.standing.scene
        releases = tuple(release for release in self._released.values() if release.position >= switch.position)
        # The data alone: it is no news to who has decided it, and nothing to others.
        value = DecidedValue(switch.position, LogValue(switch.value.data), proof.ballot, proof.votes, releases)
        packet = RespondSceneLog(None, DecidedLog(self._modes.public.genesis, switch.position, (value,)))
        nodes = {member.node for member in before.everyone | after.everyone} - {self._own.me}
        async with trio.open_nursery() as nursery:
            for node in sorted(nodes):
                nursery.start_soon(self._tell, node, packet)

    async def _tell(self, node: NodeId, packet: Packet) -> None:
        try:
            await self._peers.tell(node, Priority.HIGH, packet, LEASE_ASK_S_MAX)
        except (Refused, Unreachable, PeerFault) as problem:
            _log.debug("node %s is not told of a release: %s", node, problem)


def key_of(member: Member, public: SceneLogPublic) -> PublicKey | None:
    """By which a participant or observer signs, as this header has it."""
    everyone: tuple[ParticipantEntry, ...] = (*public.participants, *public.observers)
    return next((PublicKey(entry.key) for entry in everyone if entry.member == member), None)
