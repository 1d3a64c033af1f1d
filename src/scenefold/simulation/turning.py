"""Somebody who changes how many copies spaces have, again and again, whatever the weather (workload `turns`; specs/23-turns.md).

How many must be there before a write counts stays as it is, so that the judge need not know when which number held.
"""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.base.reasons import RejectReason
from scenefold.client.scene import Scene
from scenefold.scene.log import Layouts
from scenefold.simulation.copying import KEPT, KEPT_OBJECTS, Copying, Rule
from scenefold.simulation.watch import Watch
from scenefold.simulation.workload import Tally

BETWEEN_S = (3.0, 12.0)
PATIENCE_S = 30.0
AGAIN_S = 1.0
COPIES_MOST = 5


class CopiesChanges:
    """One client at it."""

    def __init__(self, scene: Scene, seed: int, copying: Copying, watch: Watch, tally: Tally, nonsense: Callable[[], int]) -> None:
        """`nonsense`: as of a worker."""
        self._scene = scene
        self._dice = random.Random(f"turns/{seed}")
        self._least = copying.least
        self._watch = watch
        self._tally = tally
        self._nonsense = nonsense

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; then the judge is told what has come of it."""
        while not stop.is_set():
            await trio.sleep(self._dice.uniform(*BETWEEN_S))
            space, copies = self._dice.choice((KEPT, KEPT_OBJECTS)), self._dice.randint(self._least, COPIES_MOST)
            with trio.move_on_after(PATIENCE_S):
                await self._tried(lambda space=space, copies=copies: self._change(space, copies))  # type: ignore[misc]
        while not await self._tried(self._tell):  # noqa: ASYNC110 - who keeps the log tells nobody when it is back
            await trio.sleep(AGAIN_S)

    async def _change(self, space: SpaceId, copies: int) -> None:
        said = await self._scene.space(space).set_copies(copies, self._least)
        self._watch.counts["copies changed"] += 1
        self._watch.tell(None, "{} has {} copies since position {}", said.name, said.copies, said.turned)

    async def _tell(self) -> None:
        """What holds for these spaces from now on."""
        header = (await self._scene.access.read_log()).header
        layouts = Layouts.of(header.spaces, header.scene)
        for space in (KEPT, KEPT_OBJECTS):
            self._watch.keeping.rules[header.scene, space] = Rule(layouts.offsets[space], self._least)

    async def _tried(self, act: Callable[[], Awaitable[None]]) -> bool:
        heard = self._nonsense()
        try:
            await act()
            self._tally.done += 1
            return True
        except Unreachable:
            self._tally.given_up += 1
        except Refused as refusal:
            self._tally.refused += 1
            is_grave = refusal.reason in (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED, RejectReason.NOT_AUTHORISED)
            if is_grave and self._nonsense() == heard:
                self._tally.wrong.append(f"changing copies is refused: {refusal}")
        except (DamagedData, PeerFault) as problem:
            if self._nonsense() == heard:
                self._tally.wrong.append(f"changing copies: {problem}")
        return False
