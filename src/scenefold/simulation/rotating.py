"""Somebody who changes the scene's keys again and again, lets a guest in and out, and seals everything anew, whatever the weather (workload `keys`)."""

from __future__ import annotations

import datetime
import random
from collections.abc import Callable

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.crypto import Card, MemberSecrets
from scenefold.simulation.workload import Tally
from scenefold.wire import Role

GUEST = "user:guest"
_DAY = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
BETWEEN_S = (3.0, 15.0)
PATIENCE_S = 60.0
"""He is interrupted then, as by a computer that is switched off, and goes on the next time."""
BYTES_PER_S = (50_000.0, 2_000_000.0)


class KeyChanges:
    """One client at it."""

    def __init__(self, scene: Scene, seed: int, guest: MemberSecrets, tally: Tally, nonsense: Callable[[], int]) -> None:
        """`guest`: somebody who does nothing with the scene; owners are revoked under another header key than others. `nonsense`: as of a worker."""
        self._scene = scene
        self._guest = Card(GUEST, (), guest.public(), 1, _DAY, _DAY, b"")
        self._dice = random.Random(f"keys/{seed}")
        self._tally = tally
        self._nonsense = nonsense

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; a change that has begun is ended, or given up."""
        while not stop.is_set():
            await trio.sleep(self._dice.uniform(*BETWEEN_S))
            act, rate = self._dice.choice(("key", "guest", "guest", "none")), self._dice.uniform(*BYTES_PER_S)
            role = self._dice.choice(list(Role))
            with trio.move_on_after(self._dice.uniform(1.0, PATIENCE_S)):
                await self._change(act, role, rate)

    async def _change(self, act: str, role: Role, rate: float) -> None:
        heard = self._nonsense()
        try:
            if act == "key":
                await self._scene.rotate_key()
            elif act == "guest" and any(member.name == GUEST for member in (await self._scene.members()).members):
                await self._scene.revoke(GUEST)
            elif act == "guest":
                await self._scene.grant(self._guest, role)
            await self._scene.reencrypt(bytes_per_s=rate)
            self._tally.done += 1
        except Unreachable:
            self._tally.given_up += 1
        except Refused as refusal:
            self._tally.refused += 1
            is_grave = refusal.reason in (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED, RejectReason.NOT_AUTHORISED)
            if is_grave and self._nonsense() == heard:
                self._tally.wrong.append(f"changing the key is refused: {refusal}")
        except (DamagedData, PeerFault) as problem:
            if self._nonsense() == heard:
                self._tally.wrong.append(f"changing the key: {problem}")
