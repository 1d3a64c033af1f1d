"""Leases that a client borrows of a scene's participants, without which it signs no edit, nor renders (specs/26-modes.md, Lent leases).

One is asked for when a write needs it, and serves all writes of the scene until it is idle. `Leases.run` renews it beside them and gives it
back; without that task each that has run out is asked for anew by the write that needs it. Asking is `Borrowing`'s (borrower.py); when to
ask, and until when to sign, `Loan` says (borrowing.py).
"""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable, Collection
from contextlib import AbstractContextManager, asynccontextmanager
from typing import TYPE_CHECKING

import trio

from scenefold.base.errors import NoLease
from scenefold.base.ids import KeyId, SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.client.borrower import Borrowing
from scenefold.crypto import SigningKey
from scenefold.wire import LeaseUse, SceneMode
from scenefold.world import background_tasks

if TYPE_CHECKING:
    from scenefold.client.access import SceneAccess
    from scenefold.client.calls import Calls
    from scenefold.client.sealing import SceneIdentity

CLOSE_S = 1.0
"""For what is still borrowed to be given back at the end. What is not runs out by itself."""
_PROCESS_BYTES = 16


class Leases:
    """Of one client. Used from the Trio thread only."""

    def __init__(self, calls: Calls) -> None:
        self.calls = calls
        self._nonce = 0
        self._all: dict[tuple[bytes, KeyId, LeaseUse], Borrowing] = {}
        self._nursery: trio.Nursery | None = None

    async def run(self) -> None:
        """Renew what writes need, and give back what they need no more, until cancelled."""
        async with trio.open_nursery() as nursery:
            self._nursery = nursery
            try:
                await trio.sleep_forever()
            finally:
                self._nursery = None

    async def close(self) -> None:
        """Give everything back, as far as that is quick. Nothing may be under way any more."""
        with trio.move_on_after(CLOSE_S, shield=True):
            async with trio.open_nursery() as nursery:
                for borrowing in self._all.values():
                    nursery.start_soon(borrowing.give_back)

    def edit(self) -> Edit:
        """Around a call that may write."""
        return Edit(self)

    @asynccontextmanager
    async def rendering(self, access: SceneAccess) -> AsyncIterator[None]:
        """Around an image of a scene that participants decide, if it is in render mode: it stays so until the end.

        Refused (9, 13) if none of them lends a lease, or if it runs out; the body is cancelled then. Who is no writer of the scene is lent none,
        and is told by what he reads if somebody edited meanwhile. In edit mode there is nothing to hold.
        """
        identity, key = access.identity, access.writer
        if not identity.deciders or identity.mode is not SceneMode.RENDER or key is None or not identity.may_write(key.key_id):
            yield
            return
        borrowing = self.of(access, key, LeaseUse.RENDER)
        await borrowing.begin(access, ())
        try:
            with trio.CancelScope() as body:
                async with background_tasks() as nursery:

                    async def watch() -> None:
                        await borrowing.lost()
                        body.cancel()

                    nursery.start_soon(watch)
                    yield
            # Whoever slept may not have noticed yet: what was read since it ended counts for nothing.
            has_ended = body.cancelled_caught or not borrowing.holds
        finally:
            borrowing.ends()
        if has_ended:
            what = "the lease under which the scene was being rendered ran out: no node that decides it answered in time"
            raise NoLease(RejectReason.MODE_FORBIDS, what, where=f"scene {access.name}", remedy="render again", was_held=True)

    def of(self, access: SceneAccess, key: SigningKey, use: LeaseUse = LeaseUse.EDIT) -> Borrowing:
        """One for each scene, key and use, however often the scene is opened. To its lender each is another borrower."""
        which = access.identity.genesis, key.key_id, use
        borrowing = self._all.get(which)
        if borrowing is None:
            process = self.calls.world.entropy.token(_PROCESS_BYTES)
            borrowing = self._all[which] = Borrowing(self, access, key, use, process)
        return borrowing

    def next_nonce(self) -> int:
        self._nonce += 1
        return self._nonce

    def start(self, task: Callable[[], Awaitable[None]]) -> bool:
        """Whether the task is begun: only where somebody runs this."""
        if self._nursery is not None:
            self._nursery.start_soon(task)
        return self._nursery is not None


class Edit(AbstractContextManager["Edit"]):
    """A call that writes to one scene. When it ends, all that it signed is settled or given up."""

    def __init__(self, leases: Leases) -> None:
        self._leases = leases
        self._borrowing: Borrowing | None = None

    def __exit__(self, *_: object) -> None:
        if self._borrowing is not None:
            self._borrowing.ends()

    async def hold(self, access: SceneAccess, needs: Collection[SpaceId]) -> SceneIdentity:
        """The scene as records may be signed for it at this very moment; whoever awaits anything asks once more.

        `needs`: the spaces of the records. Refused (9) in render mode, or if nobody lends a lease, or 13 while the mode is about to change;
        nothing has been signed then.
        """
        if not _is_needed(access.identity, needs) or access.writer is None:
            return access.identity
        borrowing = self._leases.of(access, access.writer)
        if self._borrowing is None:
            await borrowing.begin(access, needs)
            self._borrowing = borrowing
        else:
            await borrowing.hold(access, needs)
        return access.identity

    def may_send(self, identity: SceneIdentity, needs: Collection[SpaceId]) -> bool:
        """Whether what was signed for the scene as it was then was signed in time. It is to be asked before any of it leaves."""
        if self._borrowing is None:
            return not _is_needed(identity, needs)
        return self._borrowing.may_sign(identity)


def _is_needed(identity: SceneIdentity, needs: Collection[SpaceId]) -> bool:
    return bool(identity.deciders) and any(identity.is_edit(space) for space in needs)
