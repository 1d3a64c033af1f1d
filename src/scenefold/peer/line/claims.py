"""Is a piece that we are about to own another's? (specs/12-line.md, Others' claims)

One node's word does not make a place ours: neither that of a giver, who offers it, nor that of a neighbour, who says that
nobody owns it. What every node says of its own arc is signed, so who owns a place that a liar gives away has said so. Its
word may be old: then it is asked for a new one, and nothing is taken before that is here, or the log has removed it.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator, Mapping, Sequence
from itertools import takewhile
from typing import Protocol

from scenefold.base.errors import Refused
from scenefold.base.ids import NodeId, address_of
from scenefold.base.location import WHOLE_LINE, Arc
from scenefold.base.reasons import RejectReason
from scenefold.peer.line.rules import Standing
from scenefold.peer.line.settling import settling_s
from scenefold.world import Clock


class News(Protocol):
    """What the other nodes said of their arcs (Roster)."""

    def arcs(self) -> Mapping[NodeId, Arc | None]: ...
    def is_unheard(self, member: NodeId) -> bool:
        """Whether no status of a registered node is known: in passing it only says where its arc ends."""
        ...

    def former_arcs(self, now: float) -> Sequence[Arc]:
        """What those claimed whom the log has removed, until their leases are over."""
        ...


class Log(Protocol):
    @property
    def registry(self) -> Standing: ...


def asked_about(piece: Arc, standing: Standing, me: NodeId, own: Arc | None) -> tuple[NodeId, ...]:
    """Who could own a part of a piece beside our arc: arcs ascend in the order of the log, so who stands on that side. Pure."""
    rank = standing.rank(me)
    lefts, rights = standing.order[:rank], standing.order[rank + 1 :]
    if own is None:
        return (*lefts, *rights)
    return lefts if piece.first < own.first else rights


def claimants(piece: Arc, standing: Standing, said: Mapping[NodeId, Arc | None], nodes: Sequence[NodeId]) -> Iterator[NodeId]:
    """Those of the nodes who claim a part of the piece; who was never heard claims the arc that it was founded with. Pure."""
    for node in nodes:
        # A founder that has not come yet owns its seat's arc, whoever was heard at its address.
        is_heard = node in said and standing.current(node) is not None
        claim = said[node] if is_heard else standing.founding_arc(node)
        if claim is not None and claim.intersection(piece) is not None:
            yield node


class Claims:
    """Used from the Trio thread only. `ask`: have a node say its status now; returns once it did, or seems not to."""

    def __init__(self, clock: Clock, log: Log, news: News, me: NodeId) -> None:
        self._clock = clock
        self._log = log
        self._news = news
        self._me = me
        self._since = clock.now()
        self.ask: Callable[[NodeId], Awaitable[object]] = _nobody

    def require_free(self, piece: Arc, own: Arc | None, *, giver: NodeId | None = None) -> None:
        """Refused (16) if, as far as is known, somebody else than the giver owns a part of the piece."""
        other = self._other(piece, own, giver)
        if other is not None:
            raise _not_ready(f"{address_of(other)} says that a part of the piece is its own")
        if giver is not None and any(arc.intersection(piece) is not None for arc in self._news.former_arcs(self._clock.now())):
            raise _not_ready("who was removed may still speak for a part of the piece")
        # A gap can wait for those who are silent: they are heard, or removed.
        if giver is None or self._clock.now() - self._since < settling_s():
            self._require_heard(piece, own, giver)

    async def look(self, piece: Arc, own: Arc | None, *, giver: NodeId | None = None) -> None:
        """The same, after asking who is in the way: what it said may be long over."""
        other = self._other(piece, own, giver)
        if other is not None:
            await self.ask(other)
        self.require_free(piece, own, giver=giver)

    def waiting_left(self, me: NodeId) -> Sequence[NodeId]:
        """The registered nodes directly left of this one that say that they own nothing, the nearest first."""
        standing, said = self._log.registry, self._news.arcs()
        lefts = reversed(standing.order[: standing.rank(me)])
        return tuple(takewhile(lambda node: standing.current(node) is not None and said.get(node, WHOLE_LINE) is None, lefts))

    def _other(self, piece: Arc, own: Arc | None, giver: NodeId | None) -> NodeId | None:
        nodes = [node for node in self._nodes(piece, own) if node != giver]
        return next(claimants(piece, self._log.registry, self._news.arcs(), nodes), None)

    def _require_heard(self, piece: Arc, own: Arc | None, giver: NodeId | None) -> None:
        for node in self._nodes(piece, own):
            if node != giver and self._news.is_unheard(node):
                raise _not_ready(f"{address_of(node)} has not said yet what it owns")

    def _nodes(self, piece: Arc, own: Arc | None) -> tuple[NodeId, ...]:
        standing = self._log.registry
        if not standing.stands(self._me):
            raise _not_ready("this node is no member, as far as it knows")
        return asked_about(piece, standing, self._me, own)


def _not_ready(what: str) -> Refused:
    return Refused(RejectReason.NOT_READY, what)


async def _nobody(_node: NodeId) -> None:
    """Before there is anything to ask by, what is known must do."""
