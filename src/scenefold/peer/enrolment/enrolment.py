"""How a node becomes a member, and what it does when it is one no more (specs/15-cluster-log.md, Enrolment).

    next step            when the log as this node knows it says
    ---------            ---------------------------------------
    WAIT                 nothing yet
    BE_MEMBER            this incarnation is registered
    RENEW                this incarnation was removed; or the voter granted it a lease that this disk does not know of: a restored backup
    TAKE_SEAT            this node is a founder whose seat is vacant
    JOIN                 nothing of this node, or only an earlier incarnation of it, which the voter will retire
    GIVE_UP              this node is the only voter, and the log knows it under another incarnation: what it decided is lost

`next_step` is the table; `Enrolment` carries it out. RENEW ends this life of the node: the store takes a new incarnation,
and `IdentityRenewed` goes up to whoever runs the node, which begins again with everything it had in memory gone. What the
disk holds is then nobody's arc, and is handed to the owners as strays. How a newcomer chooses its place is decided
elsewhere: `join` is given from outside (balance), and returns or raises once it has tried.
"""

from __future__ import annotations

import logging
from collections.abc import Awaitable, Callable
from enum import Enum, auto
from functools import partial

import trio

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.peer.cluster_log.cluster_log import ClusterLog
from scenefold.peer.cluster_log.lease import OwnerLease
from scenefold.peer.cluster_log.registry import Registry
from scenefold.peer.membership.status import OwnStatus
from scenefold.peer.timing import ENROL_RETRY_S, SYNC_S
from scenefold.store import Store
from scenefold.wire import AddNode, Member
from scenefold.world import World, first_of
from scenefold.world.quiet import QuietLog

Join = Callable[[], Awaitable[None]]
"""Registers this node left of another one. It may fail as requests fail, and is tried again."""

LEARN_S = 2 * SYNC_S
"""For a node that voted alone once, and has lost its disk, to learn that others vote since."""
WAITING = "waiting until the lease of this node's earlier incarnation is over, or for its turn if it has begun anew many times lately"
"""What a voter that is busy with us means (beginnings.py)."""

_log = logging.getLogger("scenefold.peer.enrolment.enrolment")


class Step(Enum):
    """See the table above."""

    WAIT = auto()
    BE_MEMBER = auto()
    RENEW = auto()
    TAKE_SEAT = auto()
    JOIN = auto()
    GIVE_UP = auto()


class IdentityRenewed(Exception):
    """The store has a new incarnation: run the node again on the same data folder."""


def next_step(registry: Registry, me: Member, *, is_rolled_back: bool) -> Step:
    """What the node has to do next."""
    known = registry.current(me.node)
    if registry.position == 0:
        return Step.WAIT
    if known is not None and known.incarnation == me.incarnation:
        return Step.RENEW if is_rolled_back else Step.BE_MEMBER
    if known is not None and registry.voters == (me.node,):
        return Step.GIVE_UP
    if registry.removal(me.incarnation) is not None:
        return Step.RENEW
    return Step.JOIN if registry.vacant_seat(me.node) is None else Step.TAKE_SEAT


def registration(own: OwnStatus, left_of: NodeId) -> AddNode:
    """The entry that registers this node: left of another one, or (0) on its founding seat."""
    return AddNode(own.member, own.key.public.raw, own.secrets.sealing.public.raw, address_of(own.me), left_of)


class Enrolment:
    """Carries the steps out. `join` may be set until `run` begins; without it, a newcomer stands left of the first node."""

    def __init__(self, world: World, store: Store, cluster_log: ClusterLog, lease: OwnerLease, own: OwnStatus) -> None:
        self._world = world
        self._store = store
        self._cluster_log = cluster_log
        self._lease = lease
        self._own = own
        self._quiet = QuietLog(_log, logging.INFO)
        self._request: bytes | None = None
        self._has_tried = False
        self.join: Join = self._join_first
        self.leaving: Callable[[], bool] = lambda: False
        """Whether the removal of this node is its own doing: then it does not come back, and somebody else ends its life."""
        self.waits_for = "for a node of the cluster that tells who its members are"
        """What keeps this node from being a member, for people; empty once it is one."""

    async def registered(self) -> None:
        """Return once this node is a member."""
        registry = self._cluster_log.registry
        while not registry.is_current(self._own.member):
            registry = await self._cluster_log.changed_after(registry.position)

    async def run(self) -> None:
        """Become a member, and look after that, until cancelled. IdentityRenewed or LocalFault end the node."""
        while True:
            registry = self._cluster_log.registry
            if self._lease.revoked.is_set() or registry.is_barred(self._own.me):
                raise self._revoked()
            match next_step(registry, self._own.member, is_rolled_back=self._lease.rolled_back.is_set()):
                case Step.WAIT:
                    await self._cluster_log.changed_after(registry.position)
                case Step.BE_MEMBER:
                    self.waits_for = ""
                    await self._until_concerned(registry)
                case Step.RENEW if self.leaving():
                    await self._cluster_log.changed_after(registry.position)
                case Step.RENEW:
                    await self._renew(registry)
                case Step.TAKE_SEAT:
                    await self._try(self._take_seat)
                case Step.JOIN:
                    await self._try(self.join)
                case Step.GIVE_UP if await self._learns_more(registry):
                    # It was one of several, and knows a part of the log yet.
                    continue
                case Step.GIVE_UP:
                    raise LocalFault(
                        "this node decides the cluster's log, and its data folder is not the one that it decided with",
                        where=address_of(self._own.me),
                        remedy="restore its data folder; the other nodes still know the log up to "
                        f"position {registry.position}, but nobody may decide in its place",
                    )

    async def _learns_more(self, registry: Registry) -> bool:
        """Whether others tell, in a while, what votes decided behind this."""
        if registry.voting.councils:
            with trio.move_on_after(LEARN_S):
                await self._cluster_log.changed_after(registry.position)
        return self._cluster_log.registry.position > registry.position

    async def _until_concerned(self, registry: Registry) -> None:
        """Wait for the next record, or for the word of the voter that this disk is an old one, or our key revoked."""
        await first_of(self._lease.rolled_back.wait, self._lease.revoked.wait, partial(self._cluster_log.changed_after, registry.position))

    async def _renew(self, registry: Registry) -> None:
        removal = registry.removal(self._own.incarnation)
        why = "its data is older than what it said before" if removal is None else f"it was removed: {removal.reason}"
        try:
            identity = await self._store.renew_identity()
        except Refused as refusal:
            # A full disk: until there is room, this life goes on and says what it knows, without a lease.
            self._say(refusal)
            await self._world.clock.sleep(ENROL_RETRY_S)
            return
        _log.warning("this node begins anew as incarnation %s: %s", identity.incarnation.hex()[:8], why)
        raise IdentityRenewed

    async def _try(self, way: Join) -> None:
        if not self._has_tried:
            voters = ", ".join(map(address_of, self._cluster_log.registry.voters))
            self._has_tried = True
            self.waits_for = f"for the voter, {voters}, which decides who is a member"
        try:
            await way()
        except (Refused, Unreachable, PeerFault) as problem:
            if isinstance(problem, Refused) and problem.reason is RejectReason.KEY_REVOKED:
                raise self._revoked() from problem
            self._say(problem)
            await self._world.clock.sleep(ENROL_RETRY_S)

    def _revoked(self) -> LocalFault:
        address = address_of(self._own.me)
        return LocalFault(
            "the key of this node was revoked: it is no part of the cluster any more",
            where=address,
            remedy=f"to take it in again, under new keys: scenectl cluster invite --address {address}",
        )

    def _say(self, problem: ScenefoldError) -> None:
        waiting = isinstance(problem, Refused) and problem.reason is RejectReason.BUSY
        text = WAITING if waiting else str(problem)
        if isinstance(problem, Unreachable):
            text = f"the voter, which decides who is a member, does not answer: {text}"
        self.waits_for = text
        self._quiet.say(self._world.clock.now(), "enrolment", "waiting" if waiting else "refused", text)

    async def _take_seat(self) -> None:
        await self._propose(NodeId(0))

    async def _join_first(self) -> None:
        await self._propose(self._cluster_log.registry.order[0])

    async def _propose(self, left_of: NodeId) -> None:
        # One request for all tries: should an answer be lost, the next try learns that it was committed.
        self._request = self._request or self._world.entropy.token(16)
        await self._cluster_log.propose(registration(self._own, left_of), self._request)
