"""Clients that change a scene's log all the time, each at its own pace, and none waits for another (workload `logs`; specs/17-simulation.md, Logs).

What somebody wants is a request, with an id that it keeps however often it is asked for: after no answer it is asked for again, as often as
a patient user would, and now and then once more after it was acknowledged. What was told goes into the history, and the judge does the rest.
"""

from __future__ import annotations

import random
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

import trio

from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable
from scenefold.base.ids import SpaceId
from scenefold.client.births import grant_of
from scenefold.client.copies import new_copies
from scenefold.client.new_space import new_space
from scenefold.client.requests import Request
from scenefold.client.scene import Scene
from scenefold.client.scene_log import LogAccess, ReadLog
from scenefold.crypto import MemberSecrets
from scenefold.scene.layout import META
from scenefold.scene.log import LoggedSpace, SceneLog
from scenefold.simulation.faults import CLIENTS
from scenefold.simulation.log_history import Attempt, Told
from scenefold.simulation.log_watch import LogWatch
from scenefold.simulation.workload import client_name
from scenefold.wire import Batch, KeyEpoch, LogEntry, Revoke, Role, ScaleSpace, SceneMode, SetMode, TranslateSpace

Make = Callable[[SceneLog], LogEntry]

PAUSE_S = 2.0
"""Between the requests of one client, on average."""
PATIENCE_S = (3.0, 25.0)
"""So long one attempt is waited for."""
TRIES = 4
REST_S = 0.5
LOOKS = 0.4
"""Odds that who was not answered asks at first what became of it, and does not just repeat it."""
AGAIN = 0.08
"""Share of acknowledged requests that are asked for once more."""
KEEPS_COPIES = 4
"""One seed of so many has spaces with shadows, whose copies nodes compare all the time: half of what such a seed takes."""
SPACES_MAX = 4
"""That one client makes: each is in all later headers."""
CLIENT_NAMES = tuple(client_name(number).partition(":")[2] for number in range(CLIENTS))
_GUEST = "user:guest"
_ACTS = {"translate": 40, "scale": 6, "copies": 2, "create": 8, "guest": 8, "key": 2, "clash": 2, "mode": 1, "translate another's": 12}


@dataclass(slots=True)
class Work:
    """What all clients of a run share."""

    watch: LogWatch
    now: Callable[[], float]
    wrong: list[str]
    """What no client must be told, in words."""
    guest: MemberSecrets
    """Somebody who is let in and out, and does nothing else."""


class LogClient:
    """One client at it. `nonsense`: how many answers of lying nodes it was given; then it may complain."""

    def __init__(self, name: str, scene: Scene, seed: int, work: Work, nonsense: Callable[[], int]) -> None:
        self.name = name
        self.dice = random.Random(f"log work/{seed}/{name}")
        self.watch = work.watch
        self._scene, self._work, self._nonsense = scene, work, nonsense
        self._made = 0
        self._keeps_copies = seed % KEEPS_COPIES == 0
        self._read: ReadLog | None = None
        """The log with what was asked for last."""

    async def run(self, stop: trio.Event) -> None:
        """Until told to stop; a request that has begun is ended, or given up."""
        await self.want(self._create())
        while not stop.is_set():
            await trio.sleep(self.dice.random() * 2 * PAUSE_S)
            act = self.dice.choices(list(_ACTS), list(_ACTS.values()))[0]
            await self.want(self._make(act))

    async def last(self) -> ReadLog | None:
        """One entry more; the log with it, None if it did not go in."""

        def entry(log: SceneLog) -> LogEntry:
            # In render mode no space is moved; a new key is taken in any.
            return self._next_key(log) if log.mode is SceneMode.RENDER else self._moved(log, [1.0, 0.0, 0.0], own=True)

        told = await self.want(entry)
        return self._read if told is Told.COMMITTED else None

    # ------------------------------------------------------------------------------------------------------ entries

    def _make(self, act: str) -> Make:
        """What is to be proposed, made anew from whatever the log says by then. While the scene is rendered spaces stay, and who wants that is refused."""
        match act:
            case "create" if self._made < SPACES_MAX:
                return self._create()
            case "scale":
                factor = self.dice.choice([0.5, 2.0])
                return lambda log: ScaleSpace(self._space(log, own=True), factor)
            case "copies" if self._keeps_copies:
                copies = self.dice.randint(1, 3)
                return lambda log: new_copies(self._space(log, own=True), copies, None)(log)
            case "mode":
                return switched
            case "clash":
                # There is one of that name, so that nothing comes of it.
                return new_space(f"{self.name} 1", copies=1)
            case "guest":
                return self._let_in_or_out
            case "key":
                return self._next_key
        steps, is_own = [float(self.dice.randint(-9, 9)) for _ in range(3)], act == "translate"
        return lambda log: self._moved(log, steps, own=is_own)

    def _create(self) -> Make:
        self._made += 1
        return new_space(f"{self.name} {self._made}", copies=self.dice.choice([1, 1, 1, 1, 2, 3]) if self._keeps_copies else 1)

    def _space(self, log: SceneLog, *, own: bool) -> SpaceId:
        """One of those that clients have made; the same one for the same log."""
        found = [
            space.id for space in log.spaces.values() if not space.parent and _maker_of(space) in ((self.name,) if own else CLIENT_NAMES)
        ]
        return found[log.position % len(found)] if found else META

    def _moved(self, log: SceneLog, steps: list[float], *, own: bool) -> TranslateSpace:
        space = self._space(log, own=own)
        return TranslateSpace(space, tuple((steps * 8)[: log.space(space).dimensions]))

    def _let_in_or_out(self, log: SceneLog) -> LogEntry:
        guest = next((member for member in log.grants.members if member.name == _GUEST), None)
        if guest is not None:
            return Batch((Revoke(guest.key), self._next_key(log)))
        keys = self._work.guest.public()
        return grant_of(_GUEST, Role.READER, keys.signing, keys.sealing)

    def _next_key(self, log: SceneLog) -> KeyEpoch:
        epoch = log.grants.key_epoch
        return KeyEpoch(epoch + 1, self._log.keys.epochs[epoch])

    # ----------------------------------------------------------------------------------------------------- requests

    async def want(self, make: Make) -> Told:
        """Ask for one entry until it is known what became of it, or nobody would ask any more."""
        request, told, offered_at = self.dice.randbytes(16), Told.UNKNOWN, 0
        made = steady(make)

        def noting(log: SceneLog) -> LogEntry:
            nonlocal offered_at
            entry = made(log)
            offered_at = max(offered_at, log.position + 1)
            return entry

        for _ in range(TRIES):
            told = await self._once(request, lambda: self._proposed(noting, Request(request, offered_at)))
            if told is Told.UNKNOWN and self.dice.random() < LOOKS:
                told = await self._once(request, lambda: self._looked(request, offered_at))
            if told is not Told.UNKNOWN:
                break
            await trio.sleep(REST_S * self.dice.random())
        if told is Told.COMMITTED and self.dice.random() < AGAIN:
            await self._once(request, lambda: self._proposed(noting, Request(request, offered_at)))
        return told

    async def _once(self, request: bytes, ask: Callable[[], Awaitable[tuple[Told, int]]]) -> Told:
        """One attempt, whatever comes of it."""
        attempt, heard = self.watch.history.asks(request, self.name, self._work.now()), self._nonsense()
        told, position = Told.UNKNOWN, 0
        try:
            with trio.move_on_after(self.dice.uniform(*PATIENCE_S)):
                told, position = await ask()
        except Unreachable:
            pass
        except (Refused, LocalFault):
            told = Told.REFUSED
        except (DamagedData, PeerFault) as problem:
            if self._nonsense() == heard:
                self._work.wrong.append(f"{self.name}: a change of the log: {problem}")
        finally:
            self._ended(attempt, told, position)
        return told

    async def _proposed(self, make: Make, request: Request) -> tuple[Told, int]:
        self._read = read = await self._log.propose(make, again=request)
        self.watch.shown(self.name, read.header)
        return Told.COMMITTED, read.state.requests[request.id]

    async def _looked(self, request: bytes, offered_at: int) -> tuple[Told, int]:
        """Whoever nobody answered asks what became of it."""
        try:
            standing = await self._log.standing(request, offered_at)
        except (Refused, LocalFault):
            # That says nothing about the request.
            return Told.UNKNOWN, 0
        if standing.position is not None:
            return Told.COMMITTED, standing.position
        return (Told.NEVER if standing.is_over else Told.UNKNOWN), 0

    @property
    def _log(self) -> LogAccess:
        assert self._scene.access.log is not None
        return self._scene.access.log

    def _ended(self, attempt: Attempt, told: Told, position: int) -> None:
        self.watch.history.ends(attempt, told, position)
        self.watch.told(attempt)


def steady(make: Make) -> Make:
    """The same entry of one log however often it is asked for, as whoever keeps a request owes it: what `make` goes by beside the log may change
    in the meantime, and its entry would be taken for another change than the one that is in the log.
    """
    made: dict[int, LogEntry] = {}

    def entry_of(log: SceneLog) -> LogEntry:
        if log.position not in made:
            made[log.position] = make(log)
        return made[log.position]

    return entry_of


def switched(log: SceneLog) -> SetMode:
    """The other mode."""
    return SetMode(SceneMode.EDIT if log.mode is SceneMode.RENDER else SceneMode.RENDER)


def _maker_of(space: LoggedSpace) -> str:
    return space.name.partition(" ")[0]
