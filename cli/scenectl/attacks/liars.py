"""A member that owns a part of the line and lies to those who read there; and somebody who does."""

from __future__ import annotations

import trio

from scenectl.attacks.attacker import PAUSE_S, Attacker
from scenectl.attacks.node import GARBAGE, OLD
from scenefold.base.errors import DamagedData, PeerFault, ScenefoldError
from scenefold.base.location import Location
from scenefold.client import Space, connect

PLACES = 8


async def answers_with_garbage(me: Attacker) -> None:
    """Records with a bit that is wrong, or noise."""
    await _is_lied_to(me, GARBAGE)


async def answers_with_an_old_version(me: Attacker) -> None:
    """What a writer signed once, and has written over since."""
    await _is_lied_to(me, OLD)


async def _is_lied_to(me: Attacker, lie: str) -> None:
    """Write and read where the liar owns the line, and judge what the client makes of the answers."""
    places = [Location.from_number(me.far.number + index) for index in range(PLACES)]
    async with connect(me.profile.folder) as cluster:
        scene = await cluster.scenes.open(me.scene_name)
        space = scene.space(me.space)
        await space.put_many([(place, b"first") for place in places])
        me.lie.write_text(lie)
        turn = 0
        try:
            while True:
                turn += 1
                await _turn(me, space, places, turn.to_bytes(8, "big"))
                await trio.sleep(PAUSE_S)
        finally:
            me.lie.unlink(missing_ok=True)


async def _turn(me: Attacker, space: Space, places: list[Location], payload: bytes) -> None:
    try:
        await space.put_many([(place, payload) for place in places])
    except ScenefoldError as error:
        me.seen[f"writes: {type(error).__name__}"] += 1
        return
    for place in places:
        me.seen[await made_of_an_answer(space, place, payload)] += 1


async def made_of_an_answer(space: Space, place: Location, truth: bytes) -> str:
    """Of each place by itself: a lie that is refused would hide one beside it that is taken, and so would a warning.

    Only what the client says of the answer refuses a lie; that there was none, or that an owner had no lease, is no merit.
    """
    warnings = _warnings(space, place)
    try:
        found = await space.get(place)
    except (DamagedData, PeerFault):
        return "lies refused"
    except ScenefoldError as error:
        return f"reads: {type(error).__name__}"
    if found == truth:
        return "true answers"
    return "old, and the reader was warned" if _warnings(space, place) > warnings else "wrong, and taken"


def _warnings(space: Space, place: Location) -> int:
    """How often the client has said that it was led back there."""
    return space._access.setbacks.of((space.id, place))
