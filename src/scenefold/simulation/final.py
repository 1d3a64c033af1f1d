"""The last look: everything that was ever acknowledged is read once more, and every history is judged."""

from __future__ import annotations

from collections import Counter

from scenefold.base.errors import ScenefoldError
from scenefold.base.ids import SpaceId
from scenefold.base.location import FIRST, LAST, Location
from scenefold.client.managed import ManagedPlace
from scenefold.simulation import laws
from scenefold.simulation.clients import Client
from scenefold.simulation.history import Listing, Outcome, Place, Purge, Read, Write
from scenefold.simulation.linearizable import judge
from scenefold.simulation.watch import Watch


async def read_everything(watch: Watch, client: Client) -> None:
    """Read every place that any client wrote to, and list every space, into the histories."""
    assert client.scene is not None
    try:
        for space, names in sorted(watch.recorder.places.items()):
            if any(Place(*space, name).is_object for name in names):
                await _read_managed(watch, client, space, names)
            else:
                await _read_fixed(watch, client, space, names)
    except ScenefoldError as problem:
        watch.violated(laws.READABLE, f"not everything can be read at the end: {problem}")


async def _read_fixed(watch: Watch, client: Client, space: tuple[int, int], names: set[bytes]) -> None:
    assert client.scene is not None
    rotten = {name for name in names if Place(*space, name) in watch.recorder.damaged}
    await client.scene.access.get([(SpaceId(space[1]), Location(name)) for name in sorted(names - rotten)])
    async for _ in client.scene.space(space[1]).query(FIRST, LAST, deleted=True):
        pass
    for name in sorted(rotten):
        await _read_damaged(watch, client, Place(*space, name))


async def _read_managed(watch: Watch, client: Client, space: tuple[int, int], names: set[bytes]) -> None:
    """Records without a place of their own are looked for in the list of all, and must be found there once; then by their ids."""
    assert client.scene is not None
    begin = watch.recorder.histories.moment()
    records = client.scene.space(space[1]).managed
    found = Counter([place.object async for place in records.query(FIRST, LAST, deleted=True)])
    end = watch.recorder.histories.moment()
    for name, count in sorted(found.items()):
        if count > 1:
            watch.violated(laws.ONE_RECORD, f"{client.name} sees {name.hex()[:8]}… {count} times in a list", location=name)
    whole = [name for name in sorted(names) if Place(*space, name) not in watch.recorder.damaged]
    for name in whole:
        watch.recorder.histories.add(Place(*space, name), Listing(begin, end, name in found, client.name, 0.0))
    await records.get([ManagedPlace(LAST, name) for name in whole])
    watch.count_objects()


async def _read_damaged(watch: Watch, client: Client, place: Place) -> None:
    """What rotted and was not written anew cannot be read; what was, can."""
    assert client.scene is not None
    try:
        await client.scene.access.get([(SpaceId(place.space), Location(place.location))])
    except ScenefoldError as problem:
        watch.story.tell(0.0, None, "cannot be read: {}", problem, location=place.location)


def judge_histories(watch: Watch) -> None:
    """Every location on its own."""
    histories = watch.recorder.histories
    for place in histories.places():
        events = histories.of(place)
        verdict = judge(events)
        if verdict.holds:
            continue
        name = f"{place.location.hex()[:8]}… of space {place.space}"
        if verdict.undecided:
            watch.violated(laws.LINEARIZABLE, f"{name}: too many orders to try them all ({len(events)} events)", location=place.location)
            continue
        state = "nothing" if verdict.state is None else verdict.state.digest.hex()[:6] or "nothing, as it was purged,"
        law = laws.READABLE if _is_gone(verdict.stuck) else laws.LINEARIZABLE
        watch.violated(law, f"{name}: {_words(verdict.stuck)}, where {state} must be", location=place.location)


def _is_gone(event: object) -> bool:
    return isinstance(event, Read) and event.digest is None


def _words(event: object) -> str:
    match event:
        case Read():
            return f"{event.who} reads {'nothing' if event.digest is None else event.digest.hex()[:6]} at {event.at_s:.3f} s"
        case Listing():
            return f"{event.who} sees {'it' if event.present else 'nothing'} in a list at {event.at_s:.3f} s"
        case Purge():
            return f"{event.who} is told that {event.version.digest.hex()[:6]} is purged at {event.at_s:.3f} s"
        case Write():
            word = "is told that it stored" if event.outcome is Outcome.DONE else "is refused"
            return f"{event.who} {word} {event.version.digest.hex()[:6]} at {event.at_s:.3f} s"
    return "no order explains it"
