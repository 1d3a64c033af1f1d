"""Which nodes must hold no copies of what this one owns: its own blacklist, durable, with ChangeBlacklist (98) (specs/20-copies.md, Blacklists).

What the settings name is added at each start and never taken off: a list that an administrator has changed while the node
ran must not shrink because it is started in the usual way.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import trio

from scenefold.base.errors import DamagedData, Refused, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.limits import BLACKLIST_MAX
from scenefold.base.prefixes import ADDRESS_BITS, AddressPrefix, Blacklist
from scenefold.base.reasons import RejectReason
from scenefold.peer.handlers import Handlers, Senders
from scenefold.peer.membership.status import OwnStatus
from scenefold.wire import BlacklistChanged, ChangeBlacklist, MalformedPacket, pack_value, unpack_value

NOTE = "blacklist"
"""The name of the note that keeps it."""
_FORM = 1

_log = logging.getLogger("scenefold.peer.blacklist")


class Keeps(Protocol):
    """What is asked of the store."""

    async def put_note(self, name: str, value: bytes) -> None: ...
    async def get_note(self, name: str) -> bytes | None: ...


class OwnBlacklist:
    """`register`, then `load`. What it says stands in `own`, once it is durable."""

    def __init__(
        self, store: Keeps, own: OwnStatus, begin: Iterable[AddressPrefix], *, may_order: Callable[[str], bool] = lambda _user: True
    ) -> None:
        """`begin`: what the settings name. `may_order`: whether a user may change anything."""
        self._store = store
        self._own = own
        # Its own address may stand in settings that all nodes share; there it says nothing.
        self._begin = [prefix for prefix in begin if prefix != AddressPrefix(own.me, ADDRESS_BITS)]
        self._may_order = may_order
        self._lock = trio.Lock()

    def register(self, handlers: Handlers) -> None:
        handlers.add(ChangeBlacklist, self._on_change, senders=Senders.USERS)

    async def load(self) -> None:
        """What stands there since an earlier run, and what the settings add to it: in memory alone while the disk is full.

        UsageFault if that is too much.
        """
        note = await self._store.get_note(NOTE)
        known = Blacklist() if note is None else decode_blacklist(note)
        begun = changed(known, self._begin, ())
        if len(begun.prefixes) > BLACKLIST_MAX:
            what = f"a blacklist of {len(begun.prefixes)} entries: {len(known.prefixes)} stand there, the settings name others"
            raise UsageFault(what, remedy=f"{BLACKLIST_MAX} are allowed: name fewer, or a prefix in place of many addresses")
        try:
            await self._keep(known, begun)
        except Refused as problem:
            if problem.reason is not RejectReason.STORAGE_FULL:
                raise
            # A node whose disk is full serves what it has. The settings name the same at the next start, and the next change keeps it.
            _log.warning("the blacklist of the settings is followed, and not kept yet: %s", problem)
            self._own.blacklist = begun

    async def _on_change(self, packet: ChangeBlacklist, peer: str) -> BlacklistChanged:
        if (packet.add or packet.remove) and not self._may_order(peer):
            raise Refused(RejectReason.NOT_AUTHORISED, f"{peer} is no administrator of this cluster", remedy="ask one who is")
        # Two at once would both build on what stood there before.
        async with self._lock:
            present = self._own.blacklist
            if packet.expected not in (None, present.version):
                what = f"the blacklist has version {present.version}, not {packet.expected}: somebody else has changed it"
                raise Refused(RejectReason.STALE_VERSION, what, remedy="look at it again")
            await self._keep(present, ordered(present, packet.add, packet.remove, self._own.me))
            return BlacklistChanged(*self._own.blacklist)

    async def _keep(self, before: Blacklist, now: Blacklist) -> None:
        if now != before:
            await self._store.put_note(NOTE, encode_blacklist(now))
            _log.info("no copies of this node's data on: %s", ", ".join(map(str, now.prefixes)) or "(all may hold them)")
        self._own.blacklist = now


def changed(known: Blacklist, add: Iterable[AddressPrefix], remove: Iterable[AddressPrefix]) -> Blacklist:
    """The blacklist with and without these, of a new version if that changes anything."""
    prefixes = tuple(sorted(set(known.prefixes) - set(remove) | set(add)))
    return known if prefixes == known.prefixes else Blacklist(known.version + 1, prefixes)


def ordered(known: Blacklist, add: Sequence[AddressPrefix], remove: Sequence[AddressPrefix], me: NodeId) -> Blacklist:
    """The same for somebody's order: Refused where it cannot be meant so."""
    whose = address_of(me)
    if AddressPrefix(me, ADDRESS_BITS) in add:
        what = f"{whose} is the node's own address, which is on its blacklist always"
        raise Refused(RejectReason.OUTSIDE_BOUNDS, what, remedy="leave it out")
    unknown = [str(prefix) for prefix in remove if prefix not in known.prefixes]
    if unknown:
        what = f"{', '.join(unknown)}: not on the blacklist of {whose}"
        raise Refused(RejectReason.OUTSIDE_BOUNDS, what, remedy=f"see `scenectl node blacklist list {whose}`")
    found = changed(known, add, remove)
    if len(found.prefixes) > BLACKLIST_MAX:
        what = f"a blacklist of {len(found.prefixes)} entries, where {BLACKLIST_MAX} are allowed"
        raise Refused(RejectReason.OUTSIDE_BOUNDS, what, remedy="name a prefix in place of many addresses")
    return found


def encode_blacklist(blacklist: Blacklist) -> bytes:
    prefixes = [[prefix.address, prefix.bits] for prefix in blacklist.prefixes]
    return pack_value({"v": _FORM, "version": blacklist.version, "prefixes": prefixes}, what="blacklist")


def decode_blacklist(note: bytes) -> Blacklist:
    """DamagedData if the note is none that `encode_blacklist` writes."""
    try:
        value = unpack_value(note)
        if not isinstance(value, dict) or set(value) != {"v", "version", "prefixes"} or value["v"] != _FORM:
            raise ValueError("not the fields of a blacklist")
        found = Blacklist(_number(value["version"]), tuple(_prefix(*entry) for entry in value["prefixes"]))
        if list(found.prefixes) != sorted(set(found.prefixes)) or len(found.prefixes) > BLACKLIST_MAX:
            raise ValueError("too many prefixes, or not in order")
    except (MalformedPacket, ValueError, TypeError) as problem:
        remedy = "remove the node, wipe its data folder, and let it join anew"
        raise DamagedData("the note of this node's blacklist is damaged", remedy=remedy) from problem
    return found


def _prefix(address: Any, bits: Any) -> AddressPrefix:
    prefix = AddressPrefix(_number(address), _number(bits))
    behind = ADDRESS_BITS - prefix.bits
    if behind < 0 or prefix.address >> ADDRESS_BITS or prefix.address >> behind << behind != prefix.address:
        raise ValueError("no prefix")
    return prefix


def _number(value: Any) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 1 << 64:
        raise ValueError("no number")
    return value
