"""Requests of a client to nodes: one try, or bounded tries with pauses, and the table that says whom to ask.

Lost packets, restarted nodes and moved bounds are everyday matters, so every call here may be tried again:
all requests of a client are idempotent (a record is resent byte for byte). How often, and how long in all, is
bounded; then the last error is the caller's, in words.
"""

from __future__ import annotations

import math
from collections.abc import Awaitable, Callable, Container, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from types import MappingProxyType
from typing import TypeVar

import trio

from scenefold.base.errors import PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import (
    CLIENT_HEDGE_S,
    CLIENT_HEDGE_S_MIN,
    CLIENT_NEXT_S,
    CLIENT_OPINION_S,
    CLIENT_OPINIONS,
    CLIENT_REQUEST_S,
    CLIENT_STATUS_S,
)
from scenefold.base.location import FIRST, Location, arcs_between, even_right_bounds
from scenefold.client.adopters import Adopters
from scenefold.client.first_contact import FirstContact, NoContact
from scenefold.client.former_tables import FormerTables
from scenefold.client.hedging import first_answer, some_answers
from scenefold.client.key_use import KeyUse
from scenefold.client.leases import Leases
from scenefold.client.patience import Patience
from scenefold.client.slots import Slots
from scenefold.client.split import turned
from scenefold.client.table import Owner, RoutingTable
from scenefold.client.tail import Tails
from scenefold.client.trying import patiently, pause
from scenefold.wire import Packet, RequestTable, RespondTable, Status
from scenefold.world import Links, Priority, World

LEARN_NODES_MAX = 3
"""Nodes that are asked for a first table; with more of them away, a call had better begin to fail by itself."""

NO_REASONS: Mapping[str, str] = MappingProxyType({})

Answer = TypeVar("Answer", bound=Packet)
Result = TypeVar("Result")


def no_answer(addresses: Sequence[str], last: ScenefoldError | None, reasons: Mapping[str, str] = NO_REASONS) -> Unreachable:
    """The error if none of these nodes answers; the last one's reason often is everybody's. `reasons`: by address, as far as they are known."""
    why, where = "" if last is None else f": {_reason(last.what)}", _few(addresses)
    alike: dict[str, list[str]] = {}
    for address in addresses:
        if address in reasons:
            alike.setdefault(_reason(reasons[address]), []).append(address)
    if len(alike) > 1:
        why, where = "", "; ".join(f"{_few(those)}: {reason}" for reason, those in alike.items())
    remedy = "see that the nodes run (`scenectl node run`), can be reached, and are those of this profile; `seeds` in its cluster.toml may name others"
    return Unreachable(f"no node of the cluster answers{why}", where=where, remedy=remedy)


def _reason(what: str) -> str:
    return what.removeprefix("no connection to the node: ")


def _few(addresses: Sequence[str]) -> str:
    return ", ".join(addresses[:4]) + (" and others" if len(addresses) > 4 else "")


class Calls:
    """What all objects of one client share: links, routing table, bounds on what is in flight."""

    def __init__(
        self,
        world: World,
        links: Links,
        addresses: Sequence[str],
        node_ids: Sequence[NodeId],
        *,
        spares: Sequence[tuple[NodeId, str]] = (),
    ) -> None:
        """`addresses` and `node_ids`: the founders, in the order of the line; `spares`: who else may be there by now, whoever is asked first first.

        The even bounds between founders only tell whom to ask first; the first call takes the table of a node.
        """
        arcs = arcs_between(even_right_bounds(len(node_ids)))
        self.world = world
        founders = [Owner(node, address, arc.last, 0, arc.first) for node, address, arc in zip(node_ids, addresses, arcs, strict=True)]
        self.table = RoutingTable([*founders, *(Owner(node, address, None) for node, address in spares)])
        self.former = FormerTables()
        self._told = [*addresses, *(address for _, address in spares)]
        """What the profile names. Whatever a node says of who is there, these are asked as well."""
        self.key_use = KeyUse()
        """Of all scenes, however often each is opened, as are the leases."""
        self.leases = Leases(self)
        self._learning = trio.Lock()
        self._has_asked = False
        self._contact = FirstContact()
        self._links = links
        self.turn = Slots().turn
        """Around a request that moves records."""
        self._silent: dict[str, float] = {}
        """Addresses that did not answer the last time, and when: of two that may own a place, they are asked last."""
        self.tails = Tails(unknown_s=CLIENT_HEDGE_S, least_s=CLIENT_HEDGE_S_MIN, most_s=CLIENT_NEXT_S)
        """How long owners take to answer reads."""
        self.adopters = Adopters()
        self.told_at: dict[NodeId, float] = {}
        """When owners were last told of a node that has copies which do not count."""
        self.check_own: Callable[[], None] = lambda: None
        """Raises what forbids this client to ask anything, such as that its own key was revoked."""
        self.heard: Callable[[str, int], None] = lambda _address, _position: None
        """Told of each node that answers how far it knows the cluster's log."""

    def address_of(self, node_id: NodeId) -> str:
        """Where to reach a node; one that the table does not know yet is taken by its id."""
        owner = self.table.by_id(node_id)
        return address_of(node_id) if owner is None else owner.address

    def is_silent(self, node_id: NodeId, *, within_s: float = math.inf) -> bool:
        """Whether a node did not answer the last time, if that is no longer ago."""
        silent_at = self._silent.get(self.address_of(node_id))
        return silent_at is not None and self.world.clock.now() - silent_at <= within_s

    @property
    def knows_changes(self) -> bool:
        """Whether anybody did not answer the last time, or somebody else owned a place lately."""
        return bool(self._silent) or bool(self.former)

    def is_gone(self, node_id: NodeId) -> bool:
        """Whether a node is silent, or not there, or owns nothing."""
        owner = self.table.by_id(node_id)
        return owner is None or owner.claim is None or owner.address in self._silent

    def to_ask(self, location: Location, passed_over: Container[NodeId] = ()) -> list[Owner]:
        """Whom to ask for a location, one after the other: who may own it, those that did not answer lately last.

        `passed_over`: who has said meanwhile that it is not the owner. If they all have, they are asked again.
        """
        candidates = self.table.candidates(location)
        left = [owner for owner in candidates if owner.node_id not in passed_over] or list(candidates)
        return sorted(left, key=lambda owner: owner.address in self._silent)

    async def ask(
        self,
        address: str,
        packet: Packet,
        answer: type[Answer] | tuple[type[Answer], ...],
        *,
        priority: Priority = Priority.LOW,
        timeout_s: float = CLIENT_REQUEST_S,
    ) -> Answer:
        """One request, one try. Unreachable if there is no reply, Refused if it is a Fault, PeerFault if it is no such answer."""
        self.check_own()
        self._contact.asked(address)
        try:
            reply = await self._links.request(address, priority, packet, timeout_s)
        except Unreachable as problem:
            self._silent[address] = self.world.clock.now()
            self._contact.failed(address, problem)
            raise
        except (Refused, PeerFault):
            self._contact.made()
            self._silent.pop(address, None)
            raise
        self._contact.made()
        self._silent.pop(address, None)
        self._notice(reply, address)
        if not isinstance(reply, answer):
            raise PeerFault(f"{type(reply).__name__} is no answer to {type(packet).__name__}", where=address)
        return reply

    async def ask_any(
        self,
        packet: Packet,
        answer: type[Answer] | tuple[type[Answer], ...],
        *,
        first: NodeId | None = None,
        priority: Priority = Priority.HIGH,
        timeout_s: float = CLIENT_REQUEST_S,
    ) -> Answer:
        """Ask what any node can answer, `first` or a random one first; none that refuses speaks for the others.

        While one says nothing, others are asked as well, a few at a time.
        """
        ask = partial(self.ask_around, packet, answer, first=first, priority=priority, timeout_s=timeout_s, refusal_counts=False)
        return await self.of_any(ask)

    async def ask_around(
        self,
        packet: Packet,
        answer: type[Answer] | tuple[type[Answer], ...],
        *,
        first: NodeId | None = None,
        priority: Priority = Priority.HIGH,
        timeout_s: float = CLIENT_REQUEST_S,
        nodes_max: int | None = None,
        refusal_counts: bool = True,
        around: Callable[[], AbstractContextManager[None]] = nullcontext,
        judged: Callable[[Answer], object] = id,
    ) -> Answer:
        """One round of `ask_any`; at most `nodes_max` are asked. `refusal_counts` false: who refuses is passed over.

        `around`: entered around the question to each node, so that it sees how each of them ends. `judged`: raises PeerFault for an answer
        that is not to be believed; then the others are asked.
        """

        async def ask(address: str) -> Answer:
            with around():
                reply = await self.ask(address, packet, answer, priority=priority, timeout_s=timeout_s)
                judged(reply)
                return reply

        tries = [partial(ask, address) for address in self._addresses_from(first)[:nodes_max]]
        contact = self._contact
        return await first_answer(tries, next_after_s=contact.next_after_s, at_a_time=contact.at_a_time, refusal_counts=refusal_counts)

    async def opinions(
        self, packet: Packet, answer: type[Answer], judged: Callable[[Answer], Result], *, first: NodeId | None = None
    ) -> list[Result]:
        """What some nodes answer, up to CLIENT_OPINIONS of them, `first` among them; for what a node may lie about. `judged`: raises for what is not believed.

        Who answers so, refuses or says nothing is passed over. If all do, one of their errors, after some patience if it may pass.
        """

        async def ask(address: str) -> Result:
            return judged(await self.ask(address, packet, answer, priority=Priority.HIGH))

        return await self.several(ask, first=first)

    async def several(
        self, ask: Callable[[str], Awaitable[Result]], *, first: NodeId | None = None, count: int = CLIENT_OPINIONS
    ) -> list[Result]:
        """What `ask` returns for some nodes, up to `count` of them, by address, as `opinions`; `first` is one of them."""

        async def once() -> list[Result]:
            tries, contact = [partial(ask, address) for address in self._addresses_from(first)], self._contact
            pace = {"next_after_s": contact.next_after_s, "more_within_s": CLIENT_OPINION_S}
            return await some_answers(tries, count=count, at_a_time=max(count, contact.at_a_time), **pace)

        return await self.of_any(once)

    async def of_any(self, ask: Callable[[], Awaitable[Result]]) -> Result:
        """Rounds of asking, as long as patience lasts. Unreachable names all nodes."""
        try:
            return await self.patiently(ask, refresh=False)
        except Unreachable as error:
            raise self._no_answer(error) from error

    def _no_answer(self, last: Unreachable) -> Unreachable:
        """Of all nodes."""
        return no_answer(self._addresses_from(self.table.owners[0].node_id), last, self._contact.reasons)

    async def refresh(self, first: NodeId | None = None) -> RespondTable:
        """Take the routing table of any node, `first` if it answers."""
        reply = await self.ask_any(RequestTable(), RespondTable, first=first, timeout_s=CLIENT_STATUS_S)
        self._take(reply)
        return reply

    async def learn(self) -> None:
        """Before the first call: take the table of a node. If none answers, the call itself will say so."""
        async with self._learning:
            if self._has_asked:
                return
            self._has_asked = True
            ask = partial(self.ask_around, RequestTable(), RespondTable, timeout_s=CLIENT_STATUS_S)
            with suppress(Unreachable, Refused, PeerFault):
                self._take(await ask(nodes_max=LEARN_NODES_MAX, refusal_counts=False))

    def _take(self, reply: RespondTable) -> None:
        # A node's address follows from its id: nobody has another's by the word of a third.
        owners = [
            Owner(status.node, address_of(status.node), status.right_bound, status.lamport, _first_of(status), status.blacklist)
            for status in reply.statuses
        ]
        # A node that has just begun knows nobody yet: then what we know is better.
        if any(owner.right_bound is not None for owner in owners):
            self._believe(RoutingTable(owners))

    def _believe(self, table: RoutingTable) -> None:
        self.former.replaced(self.world.clock.now(), self.table, table)
        self.table = table

    async def patiently(self, call: Callable[[], Awaitable[Result]], *, refresh: bool = True) -> Result:
        """Try a call again while nodes are away or busy, as long as patience lasts, with growing pauses between."""

        async def tries() -> Result:
            if refresh:
                await self.learn()
            return await patiently(self.world, call, self.refresh if refresh else None)

        try:
            return await self._contact.bounded(tries)
        except NoContact as silence:
            raise (self._no_answer(silence) if refresh else silence) from silence.__cause__

    async def pause(self, patience: Patience) -> None:
        """Wait before the next try."""
        await pause(self.world, patience)

    def _addresses_from(self, first: NodeId | None) -> list[str]:
        """All nodes: `first`, then those that own something, begun anywhere, then those that may not even run; who was silent, last.

        At the end those of the profile that the table does not name, for a table of nobody would never be got rid of.
        """
        owning = [owner for owner in self.table.owners if owner.right_bound is not None]
        rank = {address: place for place, address in enumerate(self._told)}
        empty = sorted(
            (owner for owner in self.table.owners if owner.right_bound is None), key=lambda owner: rank.get(owner.address, len(rank))
        )
        chance = self.world.entropy.uniform()
        all_of_them = [*turned(owning, chance), *empty]
        named = [owner.address for owner in sorted(all_of_them, key=lambda owner: owner.node_id != first)]
        left = set(self._told).difference(named)
        addresses = [*named, *(address for address in turned(self._told, chance) if address in left)]
        return sorted(addresses, key=lambda address: (first is None or address != self.address_of(first)) and address in self._silent)

    def _notice(self, reply: Packet, address: str) -> None:
        news = reply.mini_status
        if news is not None and self.address_of(news.node) != address:
            # Of others it may say what it likes: they speak for themselves.
            return
        if news is not None:
            self.heard(address, news.log_position)
        # A node that owns nothing keeps its old place until the table is asked for again; until then it forwards.
        if news is not None and news.right_bound is not None:
            known = self.table.by_id(news.node)
            first = None if known is None or known.first is None or known.first > news.right_bound else known.first
            blacklist = () if known is None else known.blacklist
            self._believe(
                self.table.updated(Owner(news.node, self.address_of(news.node), news.right_bound, news.lamport, first, blacklist))
            )


def _first_of(status: Status) -> Location | None:
    """Where the arc of a status begins."""
    if status.right_bound is None:
        return None
    return FIRST if status.left_fence is None else status.left_fence.next()
