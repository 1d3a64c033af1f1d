"""Clients that edit a scene and clients that render it, while its mode is switched (workload `logs`; specs/17-simulation.md, Logs).

Who edits is patient now and then: what it has signed may wait for its owner longer than a change of mode takes.
"""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable, Sequence

import trio

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.location import Location
from scenefold.base.reasons import RejectReason
from scenefold.client.space import ABSENT
from scenefold.client.wishes import Wish
from scenefold.scene.layout import META
from scenefold.simulation.clients import Client
from scenefold.simulation.log_history import Told
from scenefold.simulation.log_modes import ModesWatch
from scenefold.simulation.log_work import LogClient, switched
from scenefold.wire import SceneMode

EDIT_PAUSE_S = 0.8
"""Between two edits of one client, on average."""
REFUSED_PAUSE_S = 1.5
"""On top, for who was refused, mostly because of the mode."""
LOOK_PAUSE_S = 0.7
EDIT_S = (8.0, 45.0)
"""How long one is waited for; the longer time is longer than leases last."""
PATIENT = 0.5
"""Share of edits, and of changes of mode, for which that is waited."""
RENDER_S = (1.0, 6.0)
BETWEEN_RENDERS_S = (2.0, 8.0)
"""A render that has begun is not cut, so two that follow each other closely would let nobody edit any more."""
FIRST_S = (1.5, 4.0)
"""Before the storm has taken hold: once most of those who decide are away, a mode stays for long."""
MODE_S = (2.0, 8.0)
"""How long a mode is left as it is, before somebody asks for the other one."""
SWITCH_TRIES = 20
"""Who asks for another mode is told to ask again, as long as somebody edits, or renders."""
SWITCH_PAUSE_S = 1.0
ACTIVE_S_MAX = 15.0
"""So long whoever switched waits for the mode to become active: longer than leases last."""
ACTIVE_LOOK_S = 0.2
_GRAVE = (RejectReason.SIGNATURE_INVALID, RejectReason.ILL_FORMED, RejectReason.NOT_AUTHORISED)


class Author:
    """One client that writes small records to a few places, one after the other. `nonsense`: how many answers of lying nodes it was given."""

    def __init__(self, client: Client, places: Sequence[Location], seed: int, nonsense: Callable[[], int], wrong: list[str]) -> None:
        self._client, self._places, self._nonsense, self._wrong = client, places, nonsense, wrong
        self._dice = random.Random(f"edits/{seed}/{client.name}")
        self._seen: dict[Location, bytes] = {}

    async def run(self, stop: trio.Event) -> None:
        while not stop.is_set():
            await trio.sleep(self._dice.random() * 2 * EDIT_PAUSE_S)
            with trio.move_on_after(EDIT_S[self._dice.random() < PATIENT]):
                if not await complaining(self._client.name, self._edit, self._nonsense, self._wrong):
                    await trio.sleep(self._dice.random() * 2 * REFUSED_PAUSE_S)

    async def _edit(self) -> None:
        dice, scene = self._dice, self._client.scene
        assert scene is not None
        places = dice.sample(self._places, dice.choice([1, 1, 1, 3]))
        # What was there when this client wrote last, or anything; now and then nothing must be there.
        expect = {place: dice.choice([None, None, self._seen.pop(place, None), ABSENT]) for place in places}
        wishes = [Wish(META, place, dice.randbytes(dice.choice([8, 40, 200])), expect[place]) for place in places]
        for place, placed in zip(places, await scene.access.put(wishes), strict=True):
            if not placed.reason:
                self._seen[place] = placed.digest


class Viewer:
    """One client that renders whenever the scene is in render mode: it reads all places, again and again, until the image is done."""

    def __init__(
        self, client: Client, places: Sequence[Location], seed: int, nonsense: Callable[[], int], wrong: list[str], modes: ModesWatch
    ) -> None:
        self._client, self._places, self._nonsense, self._wrong, self._modes = client, places, nonsense, wrong, modes
        self._dice = random.Random(f"renders/{seed}/{client.name}")
        self._has_begun = False

    async def run(self, stop: trio.Event) -> None:
        while not stop.is_set():
            await trio.sleep(self._dice.random() * 2 * LOOK_PAUSE_S)
            self._has_begun = False
            await complaining(self._client.name, self._look, self._nonsense, self._wrong)
            if self._has_begun:
                # Also behind one that came to nothing: a render that is begun again at once keeps the mode as it is.
                await trio.sleep(self._dice.uniform(*BETWEEN_RENDERS_S))

    async def _look(self) -> None:
        scene, leases = self._client.scene, self._client.calls.leases
        assert scene is not None
        header = await scene.access.log_or_fault().header()
        if header is None or header.mode is not SceneMode.RENDER:
            return
        if header.position > scene.access.identity.position:
            await scene.access.refresh(header.position)
        async with leases.rendering(scene.access):
            if scene.access.identity.mode is not SceneMode.RENDER:
                return
            self._has_begun = True
            with self._modes.rendering(self._client.name, scene, leases), trio.move_on_after(self._dice.uniform(*RENDER_S)):
                while True:
                    await scene.access.get([(META, place) for place in self._dice.sample(self._places, len(self._places))])
                    await trio.sleep(self._dice.random() * 2 * LOOK_PAUSE_S)


class Director:
    """Somebody who has a scene edited for a while, then rendered, and so on. Now and then he has no patience until a mode is active."""

    def __init__(self, client: LogClient, seed: int, modes: ModesWatch) -> None:
        self._client, self._modes = client, modes
        self._dice = random.Random(f"modes/{seed}")

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop."""
        spans = FIRST_S
        while not stop.is_set():
            with trio.move_on_after(self._dice.uniform(*spans)):
                await stop.wait()
            spans = MODE_S
            await self._switch()

    async def _switch(self) -> None:
        for _ in range(SWITCH_TRIES):
            if await self._client.want(switched) is Told.COMMITTED:
                if self._dice.random() < PATIENT:
                    await self._until_active()
                return
            await trio.sleep(SWITCH_PAUSE_S * (0.5 + self._dice.random()))

    async def _until_active(self) -> None:
        """Somebody may act in the mode that was decided last."""
        with trio.move_on_after(ACTIVE_S_MAX):
            while not self._modes.newest_is_active:  # noqa: ASYNC110 - time alone makes it active, and nobody tells of it
                await trio.sleep(ACTIVE_LOOK_S)


async def complaining(name: str, act: Callable[[], Awaitable[None]], nonsense: Callable[[], int], wrong: list[str]) -> bool:
    """Whether it came to its end. Refusals and silence are what storms are for; only nonsense without a liar is not."""
    heard = nonsense()
    try:
        await act()
        return True
    except Refused as refusal:
        if refusal.reason in _GRAVE and nonsense() == heard:
            wrong.append(f"{name}: {refusal}")
    except Unreachable as silence:
        if isinstance(silence.__cause__, DamagedData | PeerFault) and nonsense() == heard:
            wrong.append(f"{name}: {silence.__cause__}")
    except (DamagedData, PeerFault) as problem:
        if nonsense() == heard:
            wrong.append(f"{name}: {problem}")
    return False
