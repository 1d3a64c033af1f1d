"""Somebody who has deleted records purged again and again, and puts back what nodes keep apart, whatever the weather (workload `purges`)."""

from __future__ import annotations

import random
from collections.abc import Callable

import trio

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.simulation.workload import Tally

BETWEEN_S = (1.0, 6.0)
PATIENCE_S = 40.0
"""He is interrupted then, as by a computer that is switched off, and begins anew the next time."""
RESTORES = 0.2
"""Share of his acts in which he puts back what nodes keep apart."""


class Purges:
    """One client at it. `nonsense`: as of a worker."""

    def __init__(self, scene: Scene, seed: int, tally: Tally, nonsense: Callable[[], int]) -> None:
        self._scene = scene
        self._dice = random.Random(f"purges/{seed}")
        self._tally = tally
        self._nonsense = nonsense

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop."""
        while not stop.is_set():
            await trio.sleep(self._dice.uniform(*BETWEEN_S))
            restores = self._dice.random() < RESTORES
            with trio.move_on_after(self._dice.uniform(5.0, PATIENCE_S)):
                await self._act(restores=restores)

    async def _act(self, *, restores: bool) -> None:
        heard = self._nonsense()
        try:
            if restores:
                await self._scene.strays(restore=True)
            else:
                await self._scene.purge()
            self._tally.done += 1
        except (Unreachable, LocalFault):
            self._tally.given_up += 1
        except Refused as refusal:
            self._tally.refused += 1
            is_grave = refusal.reason in (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED, RejectReason.NOT_AUTHORISED)
            if is_grave and self._nonsense() == heard:
                self._tally.wrong.append(f"purging is refused: {refusal}")
        except (DamagedData, PeerFault) as problem:
            if self._nonsense() == heard:
                self._tally.wrong.append(f"purging: {problem}")
