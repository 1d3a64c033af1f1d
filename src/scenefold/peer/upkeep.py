"""Repair, scrub and balance rest, go on, and keep to other rates, by an administrator's order: durable, with ChangeUpkeep (116) (specs/21-verify.md, Upkeep).

What is ordered outlives a restart, whatever the node is started with: who has paused something because a disk is dying must not find it
running after a power cut. So a report always says what rests.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import trio

from scenefold.base.errors import DamagedData, Refused
from scenefold.base.plain_values import whole
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.line.budget import Budget
from scenefold.peer.line.resting import Resting
from scenefold.peer.scrub import Scrub
from scenefold.wire import ChangeUpkeep, MalformedPacket, UpkeepChanged, pack_value, unpack_value
from scenefold.wire.upkeep_packets import ALL_DUTIES, BALANCE, REPAIR, SCRUB

NOTE = "upkeep"
_VERSION = 1
_KEYS = {"paused", "scrub", "transfer", "v"}
_NUMBER_MAX = (1 << 63) - 1
DUTIES = {"repair": REPAIR, "scrub": SCRUB, "balance": BALANCE}
"""Their names, as a report has them."""

_log = logging.getLogger("scenefold.peer.upkeep")


@dataclass(frozen=True, slots=True)
class Orders:
    """What administrators have ordered. Rates of 0: those that the node was started with."""

    paused: int = 0
    transfer: int = 0
    scrub: int = 0

    def changed(self, order: ChangeUpkeep) -> Orders:
        """With one more order."""
        found = replace(self, paused=(self.paused & ~order.of) | (order.paused & order.of))
        if order.transfer_bytes_per_s is not None:
            found = replace(found, transfer=order.transfer_bytes_per_s)
        return found if order.scrub_bytes_per_s is None else replace(found, scrub=order.scrub_bytes_per_s)


class Keeps(Protocol):
    """What is asked of the store."""

    async def put_note(self, name: str, value: bytes) -> None: ...
    async def get_note(self, name: str) -> bytes | None: ...


class OwnUpkeep:
    """`register`, then `load`."""

    def __init__(
        self, store: Keeps, resting: Resting, budget: Budget, scrub: Scrub, *, may_order: Callable[[str], bool] = lambda _user: True
    ) -> None:
        """`budget` and `scrub` at the rates that the settings name. `may_order`: whether a user may change anything."""
        self._store = store
        self._resting = resting
        self._budget = budget
        self._scrub = scrub
        self._may_order = may_order
        self._at_start = Orders(transfer=round(budget.bytes_per_s), scrub=scrub.bytes_per_s_max)
        self._orders = Orders()
        self._lock = trio.Lock()

    def register(self, handlers: Handlers) -> None:
        handlers.add(ChangeUpkeep, self._on_change, senders=Senders.USERS)

    async def load(self) -> None:
        """Go on as ordered in an earlier life. DamagedData if that cannot be read."""
        note = await self._store.get_note(NOTE)
        if note is not None:
            self._follow(decode_orders(note))

    def document(self) -> dict[str, Any]:
        """The part of the report that speaks of it."""
        paused = [name for name, bit in DUTIES.items() if self._orders.paused & bit]
        return {"paused": paused, "transfer_bytes_per_s": round(self._budget.bytes_per_s), "scrub_bytes_per_s": self._scrub.bytes_per_s_max}

    async def _on_change(self, packet: ChangeUpkeep, peer: str) -> UpkeepChanged:
        # Two at once would both build on what was ordered before.
        async with self._lock:
            orders = self._orders.changed(packet)
            if orders != self._orders:
                if not self._may_order(peer):
                    raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no administrator of this cluster", remedy="ask one who is")
                await self._store.put_note(NOTE, encode_orders(orders))
                _log.info(
                    "by order of %s: %s rests", peer, " and ".join(n for n, bit in DUTIES.items() if orders.paused & bit) or "nothing"
                )
                self._follow(orders)
            return UpkeepChanged(self._orders.paused, round(self._budget.bytes_per_s), self._scrub.bytes_per_s_max)

    def _follow(self, orders: Orders) -> None:
        self._orders = orders
        self._resting.repair, self._resting.balance = bool(orders.paused & REPAIR), bool(orders.paused & BALANCE)
        if orders.paused & SCRUB:
            self._scrub.pause()
        else:
            self._scrub.resume()
        self._budget.bytes_per_s = orders.transfer or self._at_start.transfer
        self._scrub.bytes_per_s_max = orders.scrub or self._at_start.scrub


def encode_orders(orders: Orders) -> bytes:
    value = {"v": _VERSION, "paused": orders.paused, "transfer": orders.transfer, "scrub": orders.scrub}
    return pack_value(value, what="upkeep")


def decode_orders(note: bytes) -> Orders:
    """DamagedData if the note is none that `encode_orders` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or set(value) != _KEYS or value["v"] != _VERSION:
            raise ValueError("not the fields of orders")
        rates = whole(value["transfer"], 0, _NUMBER_MAX), whole(value["scrub"], 0, _NUMBER_MAX)
        return Orders(whole(value["paused"], 0, ALL_DUTIES), *rates)
    except (MalformedPacket, ValueError, TypeError) as problem:
        remedy = "`scenectl node repair` lets the node forget what rests"
        raise DamagedData("the note of this node's upkeep is damaged", remedy=remedy) from problem
