"""What administrators order, given to whoever decides the cluster's log (specs/15-cluster-log.md, Orders).

An order is signed by the administrator's own key, so whatever node takes it can neither alter it nor give it again.
"""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.errors import NotReached, Refused, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.doubt import Doubt
from scenefold.client.known_log import KnownLog
from scenefold.client.patience import is_passing
from scenefold.crypto import ORDER_DOMAIN, SigningKey
from scenefold.wire import AddParticipant, RemoveParticipant
from scenefold.wire.enrol_entries import Invite, RevokeUser, Withdraw
from scenefold.wire.enrol_packets import Administer, Administered
from scenefold.wire.log_entries import SingleEntry
from scenefold.wire.orders import Order
from scenefold.world import Priority

_ASK_ANOTHER = frozenset({RejectReason.NOT_READY, RejectReason.NOT_MY_LOCATION, RejectReason.NO_MAJORITY, RejectReason.STORAGE_FULL})
"""Why one voter has not carried an order out, where another one may."""
_THIS_ORDER = 0
_MET_S = 60.0
"""Whoever was shown the log so lately knows that somebody is there."""


class Orders:
    """Of one administrator, `me`, in one cluster."""

    def __init__(self, calls: Calls, cluster: bytes, me: str, key: SigningKey, log: KnownLog) -> None:
        self._calls, self._cluster, self._me, self._key, self._cluster_log = calls, cluster, me, key, log

    async def give(self, entry: SingleEntry) -> int:
        """Have it in the log; its position. It counts once, whichever voters were asked. Refused if it did not come in; Unreachable if nobody can be
        asked, or, in words, if nobody knows: a voter that took it may have voted for it and died, and the others bring that in when it is back."""
        # Without a network nobody is there: then that is told, and no order is in doubt because somebody might have heard it.
        await self._cluster_log.newest(age_s_max=_MET_S)
        world = self._calls.world
        issued, request = int(world.clock.wall()), world.entropy.token(16)
        order = Order(self._cluster, request, self._me, issued, entry).encode()
        packet = Administer(order=order, signature=self._key.sign(ORDER_DOMAIN, order))

        where = f"the cluster's log; voters {', '.join(map(address_of, self._cluster_log.voters))}"
        doubt = Doubt("an order", lambda _: where, _how_to_find_out(entry))

        async def give() -> Administered:
            problems: list[Unreachable | Refused] = []
            for voter in self._cluster_log.voters:
                try:
                    with doubt.trying([_THIS_ORDER]):
                        return await self._calls.ask(address_of(voter), packet, Administered, priority=Priority.HIGH)
                except Unreachable as problem:
                    problems.append(problem)
                except Refused as refusal:
                    if refusal.reason not in _ASK_ANOTHER:
                        raise
                    problems.append(refusal)
            raise _of_a_round(problems)

        with doubt.no_refusal(nor_silence=True):
            position = (await self._calls.patiently(give, refresh=False)).position
        self._cluster_log.has_grown()
        return position


def _how_to_find_out(entry: SingleEntry) -> str:
    """What shows whether an order is in the cluster's log, and that it may be given again."""
    if isinstance(entry, Invite):
        # Nobody was shown its token.
        return "invite again; `scenectl cluster invitations` shows whether there is one that nobody can use"
    match entry:
        case AddParticipant() | RemoveParticipant():
            shown = "voters"
        case RevokeUser():
            shown = "users"
        case Withdraw():
            shown = "invitations"
        case _:
            shown = "nodes"
    return (
        f"`scenectl cluster {shown}` shows what became of it, once a majority of the voters is there; the same command may be given again"
    )


def _of_a_round(problems: Sequence[Unreachable | Refused]) -> Unreachable | Refused:
    """What is told when no voter has carried an order out: who may have it under way, else why not, else that nobody was there."""

    def weight(problem: Unreachable | Refused) -> int:
        if isinstance(problem, Refused):
            # What may pass comes before what lasts: it is tried again.
            return 2 if is_passing(problem.reason) else 1
        return 0 if isinstance(problem, NotReached) else 3

    problem = max(reversed(problems), key=weight)
    if isinstance(problem, Refused) and problem.reason is RejectReason.NO_MAJORITY:
        what = f"no majority: of {len(problems)} voters too few answer, and nothing was changed"
        remedy = "start those that are away; `scenectl cluster status` names them"
        return Refused(problem.reason, what, where=problem.where, remedy=remedy)
    return problem
