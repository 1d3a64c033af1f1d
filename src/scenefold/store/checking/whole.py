"""A look at all of a store, table by table (specs/21-verify.md). It reads, and changes nothing."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager

from scenefold.store.checking.debts import check_debts
from scenefold.store.checking.derived import check_objects, check_statistics
from scenefold.store.checking.findings import Finding, Findings, Helps
from scenefold.store.checking.logs import check_logs
from scenefold.store.checking.records import Judge, Tell, check_records, nobody_can_tell
from scenefold.store.checking.singles import check_identity, check_values, sound_holding
from scenefold.store.checking.suspects import check_suspects
from scenefold.store.checking.tables import EVERY_KEY, Sound
from scenefold.store.checking.trees import check_trees
from scenefold.store.layout import DEBTS, DIGESTS, HOLDING, IDENTITY, LOGS, NOTES, OBJECTS, RECORDS, STATISTICS, SUSPECTS, SpaceAddress
from scenefold.store.sealing import StoreDamaged
from scenefold.store.statistics import Counts, read_counts
from scenefold.world.ports import ReadTransaction

Look = Callable[[], Iterator[Finding]]


def silent(_phase: str, _done: int, _total: int | None) -> None:
    """For who wants to hear of no progress."""


def check_store(raw: ReadTransaction, judge: Judge = nobody_can_tell, *, spare: Collection[str] = (), tell: Tell = silent) -> Findings:
    """All that is wrong with a store. `raw`: values as they stand on the disk. `spare`: notes that nobody needs.

    Some 40 us a record, and 2 ms a MiB; who judges signatures takes 200 us a record more.
    """
    found = Findings()

    def look(table: str, work: Look) -> list[Finding]:
        """What is wrong with a table, as far as it can be read."""
        here: list[Finding] = []
        with as_far_as_it_goes(table, found):
            for finding in work():
                here.append(finding)
                found.add(finding)
        return here

    look(IDENTITY, lambda: check_values(raw, spare))
    look(IDENTITY, lambda: check_identity(raw, is_empty=_is_empty(raw)))
    look(HOLDING, lambda: _holding(raw))
    look(SUSPECTS, lambda: check_suspects(raw))
    look(LOGS, lambda: check_logs(raw))
    counted: dict[SpaceAddress, Counts] | None = None
    with as_far_as_it_goes(RECORDS, found):
        counted = check_records(raw, judge, found, tell, _expected(raw))
    if counted is None:
        # Nobody knows what would follow from records that cannot be read.
        return found
    spaces = counted
    tell("what follows from them", 0, None)
    look(STATISTICS, lambda: check_statistics(raw, spaces))
    objects = look(OBJECTS, lambda: check_objects(raw))
    look(DEBTS, lambda: check_debts(raw))
    # Trees go by homes: as long as one is not known, nothing can be said of sums.
    is_known = not objects and not any(finding.table == RECORDS and finding.helps is Helps.MEND for finding in found.listed)
    look(DIGESTS, lambda: check_trees(raw, spaces, passed_over=() if is_known else spaces))
    return found


@contextmanager
def as_far_as_it_goes(table: str, found: Findings) -> Iterator[None]:
    """Where the tree itself is damaged, a table ends in the midst."""
    try:
        yield
    except StoreDamaged as damage:
        found.add(Finding(table, table, damage.what, Helps.WIPE))


def _holding(raw: ReadTransaction) -> Iterator[Finding]:
    holding = sound_holding(raw)
    if isinstance(holding, Finding):
        yield holding


def _is_empty(raw: ReadTransaction) -> bool:
    return all(next(raw.keys(table, *EVERY_KEY), None) is None for table in (RECORDS, HOLDING, NOTES, SUSPECTS, LOGS))


def _expected(raw: ReadTransaction) -> int | None:
    """How many records there should be, if that can be told."""
    try:
        return sum(counts.records for counts in read_counts(Sound(raw)).values()) or None
    except StoreDamaged:
        return None
