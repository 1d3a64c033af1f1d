"""What follows from something else is made anew (specs/21-verify.md, Repair).

One finding may hide another, or make one: a row that is put right shows that a tree is wrong. So it looks, mends and looks again.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from scenefold.base.errors import LocalFault
from scenefold.store.checking.findings import Finding, Findings, Helps
from scenefold.store.sealing import SealedEnvironment
from scenefold.world.ports import DiskFailed, DiskFull, Environment, ReadTransaction, WriteTransaction

ROUNDS_MAX = 6
"""A record is made a wreck, its tree is found to be wrong then, and so on: some two rounds in truth."""
FIXES_OF_ONE = 1_024
"""In one transaction."""


@dataclass(frozen=True, slots=True)
class Mended:
    """What was mended, in the order in which it was, and what is left."""

    done: Sequence[Finding]
    left: Findings


def mend(environment: Environment, where: str, look: Callable[[ReadTransaction], Findings]) -> Mended:
    """Mend what can be mended, unless something is wrong that nothing can mend: then nothing is changed.

    `environment` has values as they stand on the disk; `look` says what is wrong with them. LocalFault if the disk takes nothing.
    """
    sealed, done = SealedEnvironment(environment, where), list[Finding]()
    found = _looked(environment, look)
    for _ in range(ROUNDS_MAX):
        if found.counts[Helps.WIPE] or not found.fixes:
            break
        for start in range(0, len(found.fixes), FIXES_OF_ONE):
            fixes = found.fixes[start : start + FIXES_OF_ONE]
            _apply(sealed, where, fixes)
            done += fixes
        found = _looked(environment, look)
    return Mended(done, found)


def _looked(environment: Environment, look: Callable[[ReadTransaction], Findings]) -> Findings:
    with environment.read() as view:
        return look(view)


def _apply(sealed: SealedEnvironment, where: str, fixes: Sequence[Finding]) -> None:
    def change(transaction: WriteTransaction) -> None:
        for finding in fixes:
            assert finding.fix is not None
            finding.fix(transaction)

    try:
        sealed.update(change)
    except (DiskFull, DiskFailed) as error:
        raise LocalFault(str(error), where=where, remedy="free some space, or see to the disk") from error
