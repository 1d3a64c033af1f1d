"""One folder from its first byte to its last: looked at, or mended as well (specs/21-verify.md, Verify, Repair).

Plain calls that block, for who has nothing else to do: no node runs here meanwhile.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

from scenefold.base.errors import DamagedData, LocalFault
from scenefold.peer.checking.notes import SPARE, check_holding, check_notes
from scenefold.peer.checking.scenes import Scenes, known_scenes
from scenefold.peer.scrub.note import NOTE, TOLD_MAX, decode_round, encode_round
from scenefold.peer.scrub.pace import Round
from scenefold.store import LmdbDisk, StoredHolding, StoreIdentity
from scenefold.store.checking import (
    Finding,
    Findings,
    Helps,
    Sound,
    Tell,
    as_far_as_it_goes,
    check_format,
    check_store,
    mend,
    nobody_can_tell,
    read_identity,
    silent,
    sound_holding,
)
from scenefold.store.layout import HEADERS, HOLDING, NOTES, TABLES, record_key
from scenefold.store.lmdb_pages import PagesDamaged
from scenefold.store.lmdb_reading import looked_at
from scenefold.store.sealing import SealedEnvironment
from scenefold.world import DiskFailed, DiskFull, Environment, ReadTransaction


@dataclass(frozen=True, slots=True)
class Checked:
    """What a look has brought to light, and whose folder it is: None if that is damaged, or nobody's yet."""

    identity: StoreIdentity | None
    findings: Findings


@dataclass(frozen=True, slots=True)
class Repaired:
    """What was mended (or, in a dry run, would be), and what is wrong after it."""

    done: Sequence[Finding]
    after: Checked


def check_folder(folder: Path, *, signatures: bool = True, tell: Tell = silent) -> Checked:
    """Look at all of a node's folder; nothing in it changes. LocalFault if it is in use, no store, or of another format."""
    try:
        with looked_at(folder, TABLES) as raw:
            check_format(raw, str(folder))
            return Checked(read_identity(raw), check_view(raw, signatures=signatures, tell=tell))
    except PagesDamaged as damage:
        found = Findings()
        found.add_all(Finding("the tree", "", problem, Helps.WIPE) for problem in damage.problems)
        return Checked(None, found)


def mend_folder(folder: Path, *, dry_run: bool = False, signatures: bool = True, tell: Tell = silent) -> Repaired:
    """Mend what follows from something else, and leave the node word of what has rotted. If anything has to be wiped, nothing is changed."""
    before = check_folder(folder, signatures=signatures, tell=tell)
    found = before.findings
    if dry_run or found.is_sound or found.counts[Helps.WIPE]:
        return Repaired([] if found.counts[Helps.WIPE] else found.fixes, before)
    with closing(LmdbDisk().open(folder, TABLES)) as environment:
        done = mend(environment, str(folder), partial(check_view, signatures=signatures, tell=tell))
        if done.left.rotten and not done.left.counts[Helps.WIPE]:
            _leave_word(environment, str(folder), done.left)
        with environment.read() as raw:
            return Repaired(done.done, Checked(read_identity(raw), done.left))


def check_view(raw: ReadTransaction, *, signatures: bool = True, tell: Tell = silent) -> Findings:
    """All that is wrong with a store, by all that its services know. `raw`: values as they stand on the disk."""
    scenes, wrong = Scenes({}), Findings()
    with as_far_as_it_goes(HEADERS, wrong):
        scenes, headers = known_scenes(raw)
        wrong.add_all(headers)
    found = check_store(raw, scenes if signatures else nobody_can_tell, spare=SPARE, tell=tell)
    found.add_all(wrong.listed)
    with as_far_as_it_goes(HOLDING, found):
        identity, holding = read_identity(raw), sound_holding(raw)
        if identity is not None and isinstance(holding, StoredHolding):
            found.add_all(check_holding(holding, identity))
    with as_far_as_it_goes(NOTES, found):
        found.add_all(check_notes(raw))
    return found


def _leave_word(environment: Environment, where: str, found: Findings) -> None:
    """Say in the scrub's note what has rotted, so that the node asks for it when it runs."""
    with environment.read() as raw:
        note = Sound(raw).get(NOTES, NOTE.encode())
        try:
            known = Round() if note is None else decode_round(bytes(note))
        except DamagedData:
            known = Round()
    told = tuple(record_key(*spot) for spot in found.rotten[:TOLD_MAX])
    if told == known.told:
        return
    # Of more than are told the scrub finds the rest, if it begins again.
    known = replace(known, told=told) if len(found.rotten) <= TOLD_MAX else replace(Round(known.number), told=told)
    try:
        SealedEnvironment(environment, where).update(lambda view: view.put(NOTES, NOTE.encode(), encode_round(known)))
    except (DiskFull, DiskFailed) as error:
        raise LocalFault(str(error), where=where, remedy="free some space, or see to the disk") from error
