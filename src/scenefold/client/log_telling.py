"""A scene's log as people are told it: the entries, and who decided them, as one of those who did saw it (specs/16-scene-log.md, A log's story)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from scenefold.base.errors import DamagedData, PeerFault, Refused, Unreachable
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.access import SceneAccess
from scenefold.client.log_reading import ReadLog
from scenefold.client.log_story import ToldEntry, told, vouched
from scenefold.client.scene_log import LogAccess
from scenefold.wire import DecidedValue, RespondSceneLog, Want
from scenefold.world import Priority


@dataclass(frozen=True, slots=True)
class LogStory:
    """A log up to `position`, of which `entries` are the newest. `seen_by`: whose account of the decisions it is; None: there is none, `why`.

    `origin`: the node that decided what no participants did. `before`: so many positions stand in a snapshot, and have no entries any more.
    """

    position: int
    origin: NodeId
    entries: Sequence[ToldEntry]
    before: int
    seen_by: NodeId | None = None
    why: str = ""


async def story_of(access: SceneAccess, newest: int | None = None) -> LogStory:
    """The newest entries, or all. DamagedData if the log does not hold together; that nobody tells who decided is no error."""
    log = access.log_or_fault()
    read = await access.read_log()
    entries = await access.in_crypto_lane(told, read.header, read.log)
    before = entries[0].position - 1 if entries else read.header.position
    shown = entries if newest is None else entries[max(0, len(entries) - newest) :]
    story = LogStory(read.header.position, NodeId(read.header.origin), shown, before)
    if not any(entry.participants for entry in shown):
        return story
    why = ""
    for node in log.keepers.in_order(read.header):
        try:
            decided = await _decided(access, log, read, node, shown[0].position - 1)
            found = await access.in_crypto_lane(vouched, shown, read.header, decided)
        except (Unreachable, Refused, PeerFault, DamagedData) as problem:
            why = why or str(problem)
            continue
        return LogStory(story.position, story.origin, found, before, node)
    return LogStory(story.position, story.origin, shown, before, None, why)


async def _decided(access: SceneAccess, log: LogAccess, read: ReadLog, node: NodeId, have: int) -> list[DecidedValue]:
    """What a participant shows of the positions behind `have`, up to the log's."""
    newest, values = read.header.position, list[DecidedValue]()
    ask = partial(access.calls.ask, address_of(node), answer=RespondSceneLog, priority=Priority.HIGH)
    while have < newest:
        page = (await ask(log.request(Want.DECIDED, have))).decided
        if page is None or not page.decided:
            raise Refused(RejectReason.NOT_READY, "the node does not show how the log was decided", where=address_of(node))
        if any(one.position <= have for one in page.decided):
            raise PeerFault("the node shows positions that it was not asked for", where=address_of(node))
        have = page.decided[-1].position
        values += page.decided
    return [value for value in values if value.position <= newest]
