"""What administrators order, given to whoever decides the cluster's log (specs/15-cluster-log.md, Orders).

An order is signed by the administrator's own key, so whatever node takes it can neither alter it nor give it again.
"""

from __future__ import annotations

from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.ids import address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.calls import Calls
from scenefold.client.known_log import KnownLog
from scenefold.crypto import ORDER_DOMAIN, SigningKey
from scenefold.wire.enrol_packets import Administer, Administered
from scenefold.wire.log_entries import SingleEntry
from scenefold.wire.orders import Order
from scenefold.world import Priority

_ASK_ANOTHER = frozenset({RejectReason.NOT_READY, RejectReason.NOT_MY_LOCATION, RejectReason.NO_MAJORITY, RejectReason.STORAGE_FULL})
"""Why one voter has not carried an order out, where another one may."""


class Orders:
    """Of one administrator, `me`, in one cluster."""

    def __init__(self, calls: Calls, cluster: bytes, me: str, key: SigningKey, log: KnownLog) -> None:
        self._calls, self._cluster, self._me, self._key, self._cluster_log = calls, cluster, me, key, log

    async def give(self, entry: SingleEntry) -> int:
        """Have it in the log; its position. It counts once, whichever voters were asked. Refused, Unreachable."""
        world = self._calls.world
        issued, request = int(world.clock.wall()), world.entropy.token(16)
        order = Order(self._cluster, request, self._me, issued, entry).encode()
        packet = Administer(order=order, signature=self._key.sign(ORDER_DOMAIN, order))

        async def give() -> Administered:
            last: ScenefoldError | None = None
            for voter in self._cluster_log.voters:
                try:
                    return await self._calls.ask(address_of(voter), packet, Administered, priority=Priority.HIGH)
                except Unreachable as problem:
                    last = problem
                except Refused as refusal:
                    if refusal.reason not in _ASK_ANOTHER:
                        raise
                    last = refusal
            assert last is not None
            raise last

        position = (await self._calls.patiently(give, refresh=False)).position
        self._cluster_log.has_grown()
        return position
