"""Does a snapshot say of the past what was read of it before? (specs/16-scene-log.md, Snapshots.) Pure.

Most of a state is history: what stands in it with a position stays. So of two states of one log the older is in the newer, and who has
read some of the records need not take an owner's word for what they added up to.
"""

from __future__ import annotations

from itertools import takewhile

from scenefold.base.errors import Refused
from scenefold.base.limits import LOG_REQUESTS_KEPT
from scenefold.base.reasons import RejectReason
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.grants import FOR_EVER, Grants
from scenefold.scene.log.growing import items_of
from scenefold.scene.log.space import LoggedSpace
from scenefold.wire import WriterEntry


def check_agrees(one: SceneLog, other: SceneLog) -> None:
    """Refused if these cannot be states of one log."""
    older, newer = sorted((one, other), key=lambda log: log.position)
    if older.position == newer.position:
        is_same = one == other and list(one.spaces) == list(other.spaces)
        problem = "" if is_same else "the state"
    else:
        problem = _contradiction(older, newer)
    if problem:
        what = f"a snapshot tells otherwise of {problem} than what was read up to position {older.position}"
        remedy = "an owner has made it so, or the log was decided anew: start again to take what it says"
        raise Refused(RejectReason.ILL_FORMED, what, where="scene log", remedy=remedy)


def _contradiction(older: SceneLog, newer: SceneLog) -> str:
    """What the newer state has otherwise, though it bears positions up to that of the older one; empty if nothing."""
    at = older.position
    if not all(_stays(was, now, at) for was, now in ((older.write_floor, newer.write_floor), (older.purged, newer.purged))):
        return "the write floor"
    if newer.write_floor <= at and newer.mode is not older.mode:
        return "the mode"
    if len(newer.spaces) < len(older.spaces):
        return "the spaces"
    for was, now in zip(older.spaces.values(), newer.spaces.values(), strict=False):
        if not _is_later(was, now, at):
            return f"space {was.id}"
    if any(space.created <= at for space in list(newer.spaces.values())[len(older.spaces) :]):
        return "the spaces"
    if not _are_later(older.grants, newer.grants, at):
        return "members or keys"
    kept = newer.position - LOG_REQUESTS_KEPT
    if any(position > kept and newer.requests.get(request) != position for request, position in older.requests.items()):
        return "what was asked for"
    return ""


def _stays(was: int, now: int, at: int) -> bool:
    """Whether the newest position of some kind may have become this one behind `at`."""
    return now == was or now > at


def _rises(was: tuple[int, int], now: tuple[int, int], at: int) -> bool:
    """Likewise with how many there were of that kind."""
    return now[1] > was[1] if now[0] > at else now == was


def _is_later(was: LoggedSpace, now: LoggedSpace, at: int) -> bool:
    before = tuple(takewhile(lambda step: step.position <= at, items_of(now.steps)))
    return _made(was) == _made(now) and tuple(items_of(was.steps)) == before and _stays(was.turned, now.turned, at)


def _made(space: LoggedSpace) -> tuple[object, ...]:
    """What its creation said of a space, but for copies."""
    shape = space.dimensions, space.curve, space.low, space.high, space.node_managed, space.render_output
    return space.id, space.name, space.parent, space.offset, space.created, *shape


def _are_later(was: Grants, now: Grants, at: int) -> bool:
    return (
        _rises((was.keyed_at, was.key_epoch), (now.keyed_at, now.key_epoch), at)
        and _rises((was.header_keyed_at, was.header_keys), (now.header_keyed_at, now.header_keys), at)
        and _stays(was.revoked_at, now.revoked_at, at)
        and all(now.former_keys.get(epoch) == key for epoch, key in was.former_keys.items())
        and now.writer_keys[: len(was.writer_keys)] == was.writer_keys
        and [_as_of(at, term) for term in now.writers if term.from_position <= at] == [_as_of(at, term) for term in was.writers]
        and all(member in was.members for member in now.members if member.position <= at)
    )


def _as_of(at: int, term: WriterEntry) -> WriterEntry:
    """The term as it was at this position, which a record behind it cannot have ended before."""
    return WriterEntry(term.key, term.from_position, FOR_EVER if term.until_position >= at else term.until_position)
