"""A log's state as bytes, and back: what stands in place of the records that it is the fold of (specs/16-scene-log.md, Snapshots). Pure.

Who reads a state has no records to fold it from, so it is held to what every fold keeps to: an owner's program that errs is found out, and
later folding begins with nothing that it does not know. Each state has one form.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from operator import itemgetter
from types import MappingProxyType

from scenefold.base.errors import Refused
from scenefold.base.limits import HEADER_KEYS_MAX, LOG_REQUESTS_KEPT
from scenefold.base.reasons import RejectReason
from scenefold.crypto import SYMMETRIC_KEY_BYTES, PublicKey
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.grants import FOR_EVER, Grants
from scenefold.scene.log.growing import items_of
from scenefold.scene.log.new_shadows import entry_of
from scenefold.scene.log.resolution import lost_by
from scenefold.scene.log.roster import Roster, unlawful
from scenefold.scene.log.space import LoggedSpace, Step
from scenefold.wire import Grant, Role, SnapshotMember, SnapshotSpace, SnapshotState

_REQUEST_BYTES = 16


def packed_state(log: SceneLog) -> bytes:
    """The state of a log that has a record; LocalFault if it is too long for a log."""
    grants, roster = log.grants, log.roster
    return SnapshotState(
        position=log.position,
        head=log.head,
        mode=log.mode,
        write_floor=log.write_floor,
        purged=log.purged,
        spaces=tuple(map(_packed_space, log.spaces.values())),
        participants=roster.participants,
        observers=roster.observers,
        members=tuple(SnapshotMember(Grant(one.name, one.role, one.signing, one.sealing), one.position) for one in grants.members),
        writers=grants.writers,
        writer_keys=grants.writer_keys,
        keyed_at=grants.keyed_at,
        header_keyed_at=grants.header_keyed_at,
        header_keys=grants.header_keys,
        revoked_at=grants.revoked_at,
        former_keys=b"".join(key for _, key in sorted(grants.former_keys.items())),
        requests=b"".join(request for request, _ in sorted(log.requests.items(), key=itemgetter(1))),
        render=log.render,
    ).encode()


def unpacked_state(data: bytes) -> SceneLog:
    """The log that this is the state of; Refused, MalformedPacket or DamagedData if no log comes to it."""
    found = SnapshotState.decode(data)
    log = SceneLog()
    for space in found.spaces:
        log = _with_space(log, space, found.position)
    log = replace(
        log,
        position=found.position,
        head=found.head,
        mode=found.mode,
        write_floor=found.write_floor,
        purged=found.purged,
        render=found.render,
        roster=Roster(found.participants, found.observers),
        grants=_grants_in(found),
        requests=_requests_in(found),
    )
    _check_order(log)
    _check_writers(log)
    _check_positions(log)
    problem = unlawful(found.participants, found.observers)
    if problem:
        raise _ill_formed(problem)
    if packed_state(log) != data:
        raise _ill_formed("the state has another form than its own")
    return log


# ------------------------------------------------------------------------------------------------------------ spaces


def packed_steps(steps: Sequence[Step], dimensions: int) -> bytes:
    """What a log did to a space, a row for each step."""
    row = _row(dimensions)
    return b"".join(row.pack(step.position, step.factor, *step.offset) for step in steps)


def unpacked_steps(data: bytes, dimensions: int) -> list[Step]:
    """The steps that these rows are; Refused if they are none."""
    row = _row(dimensions)
    if len(data) % row.size:
        raise _ill_formed("the steps of a space are cut off")
    steps = [Step(position, factor, tuple(offset)) for position, factor, *offset in row.iter_unpack(data)]
    if not all(map(_is_step, steps)):
        raise _ill_formed("a step of a space is neither a scale nor a translation")
    if any(one.position > next_.position for one, next_ in pairwise(steps)):
        raise _ill_formed("the steps of a space are out of order")
    return steps


def _row(dimensions: int) -> struct.Struct:
    return struct.Struct(f">Q{1 + dimensions}d")


def _is_step(step: Step) -> bool:
    if step.factor == 1.0:
        return all(map(math.isfinite, step.offset))
    return 0.0 < step.factor < math.inf and not any(step.offset)


def _packed_space(space: LoggedSpace) -> SnapshotSpace:
    steps = () if space.parent else tuple(items_of(space.steps))
    return SnapshotSpace(entry_of(space), space.created, space.turned, packed_steps(steps, space.dimensions))


def _with_space(log: SceneLog, found: SnapshotSpace, newest: int) -> SceneLog:
    # A shadow finds its parent moved already, and lies where that lies.
    log = log.with_space(found.space, found.created)
    space = log.spaces[found.space.space]
    if (space.parent and (found.steps or found.turned)) or (space.node_managed and found.steps):
        raise _ill_formed(f"space {space.id} is not moved or turned by itself")
    steps = unpacked_steps(found.steps, space.dimensions)
    ends = [step.position for step in (*steps[:1], *steps[-1:])]
    if not all(space.created <= position <= newest for position in (space.created, *ends, found.turned or newest)):
        raise _ill_formed(f"space {space.id} bears a position that it cannot have")
    if steps:
        space = space.placed(steps)
        lost = lost_by(space)
        if lost is not None:
            raise _ill_formed(lost.what)
    return replace(log, spaces=MappingProxyType({**log.spaces, space.id: replace(space, turned=found.turned)}))


def _check_order(log: SceneLog) -> None:
    spaces = list(log.spaces.values())
    if not spaces or any(one.created > next_.created for one, next_ in pairwise(spaces)):
        raise _ill_formed("the spaces are not in the order of their creation")


# ----------------------------------------------------------------------------------------------- members and requests


def _grants_in(found: SnapshotState) -> Grants:
    grants = Grants()
    for member in found.members:
        grants = grants.granted(member.grant, member.position)
    keys = _cut(found.former_keys, SYMMETRIC_KEY_BYTES)
    return Grants(
        members=grants.members,
        writers=found.writers,
        writer_keys=found.writer_keys,
        key_epoch=len(keys),
        keyed_at=found.keyed_at,
        header_keyed_at=found.header_keyed_at,
        header_keys=found.header_keys,
        revoked_at=found.revoked_at,
        former_keys=MappingProxyType(dict(enumerate(keys))),
    )


def _requests_in(found: SnapshotState) -> MappingProxyType[bytes, int]:
    ids = _cut(found.requests, _REQUEST_BYTES)
    if len(ids) != min(found.position, LOG_REQUESTS_KEPT):
        raise _ill_formed(f"the request ids of {len(ids)} positions, at position {found.position}")
    return MappingProxyType(dict(zip(ids, range(found.position - len(ids) + 1, found.position + 1), strict=True)))


def _cut(data: bytes, size: int) -> list[bytes]:
    if len(data) % size:
        raise _ill_formed(f"keys or ids of {size} bytes are cut off")
    return [data[at : at + size] for at in range(0, len(data), size)]


def _check_writers(log: SceneLog) -> None:
    grants = log.grants
    keys = {PublicKey(entry.raw, entry.suite).key_id: entry for entry in grants.writer_keys}
    terms = grants.writers
    if len(keys) != len(grants.writer_keys) or keys.keys() != {term.key for term in terms}:
        raise _ill_formed("the keys of writers are not those of their terms")
    if any(one.from_position > next_.from_position for one, next_ in pairwise(terms)):
        raise _ill_formed("the terms of writers are out of order")
    for term in terms:
        ends = log.position + 1 if term.until_position == FOR_EVER else term.until_position + 1
        if not 1 <= term.from_position <= ends <= log.position + (term.until_position == FOR_EVER):
            raise _ill_formed("the term of a writer bears a position that it cannot have")
    now = sorted(term.key for term in terms if term.until_position == FOR_EVER)
    writing = [member for member in grants.members if member.role >= Role.WRITER]
    if now != sorted(member.key for member in writing) or any(keys[member.key] != member.signing for member in writing):
        raise _ill_formed("the writers are not those whose terms have no end")
    if not any(member.role is Role.OWNER for member in writing):
        raise _ill_formed("the scene has no owner")


def _check_positions(log: SceneLog) -> None:
    """Of what happened to keys and floors: no later than the state, and in an order that entries can have."""
    grants = log.grants
    keyed_at = grants.keyed_at if grants.key_epoch else 0
    if (
        not max(log.purged, grants.revoked_at, keyed_at) <= log.write_floor <= log.position
        or not grants.revoked_at <= keyed_at
        or (keyed_at < 2 if grants.key_epoch else grants.keyed_at != 1)
        or (not 2 <= grants.header_keyed_at <= grants.revoked_at if grants.header_keys else grants.header_keyed_at != 1)
        or grants.header_keys > HEADER_KEYS_MAX
        or any(member.position > log.position for member in grants.members)
    ):
        raise _ill_formed("the state bears a position that it cannot have")


def _ill_formed(what: str) -> Refused:
    return Refused(RejectReason.ILL_FORMED, what, where="snapshot")
