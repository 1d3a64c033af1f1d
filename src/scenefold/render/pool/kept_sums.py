"""What a node adds up of each pass that is open anywhere (specs/08-passes.md, *Sums of a pass on a node*).

A table takes some megabytes. Whichever thread traces rays of a pass adds to one that no other thread works with: so there are as many of a pass as
threads were ever at it at once, and not as many as there are threads.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from scenefold.render.ledger import Counts
from scenefold.render.pass_sums import PassSums
from scenefold.render.passes import PassPlan
from scenefold.render.sum_columns import SumColumns
from scenefold.wire import PassSums as PassSumsPacket


class KeptSums:
    """Of one node in one attempt. A pass's are complete once no ray of it is under way anywhere; until then threads add to them."""

    def __init__(self, plan: PassPlan, columns: SumColumns) -> None:
        self._plan, self._columns = plan, columns
        self._kept: dict[int, list[PassSums]] = {}
        self._free: dict[int, list[PassSums]] = {}
        """Of these, those that no thread works with."""

    def __len__(self) -> int:
        """Of so many passes something is kept."""
        return len(self._kept)

    def none_of(self, number: int) -> PassSums:
        """Zeros, for a pass."""
        return PassSums.zeros(self._plan.size(number), self._columns)

    @contextmanager
    def lent(self, numbers: Sequence[int]) -> Iterator[list[PassSums]]:
        """Where one thread adds what it traces of these passes, each once; nobody else does meanwhile."""
        lent = [self._lend(number) for number in numbers]
        try:
            yield lent
        finally:
            for number, sums in zip(numbers, lent, strict=True):
                if number in self._kept:
                    self._free[number].append(sums)

    def _lend(self, number: int) -> PassSums:
        free = self._free.setdefault(number, [])
        if not free:
            free.append(self.none_of(number))
            self._kept.setdefault(number, []).append(free[-1])
        return free.pop()

    def total(self, number: int) -> PassSums:
        """Of all threads. In a worker; of a pass that no thread traces."""
        kept = self._kept.get(number, [])
        if len(kept) == 1:
            return kept[0]
        total = self.none_of(number)
        for sums in kept:
            total.add(sums)
        return total

    def packed(self, number: int) -> bytes:
        """The same, for the pass's owner."""
        return self.total(number).to_bytes()

    def forget(self, number: int) -> None:
        """A pass is closed."""
        self._kept.pop(number, None)
        self._free.pop(number, None)


def sums_packet(job: int, attempt: int, number: int, payload: bytes, counts: Counts) -> PassSumsPacket:
    """Sums of a pass on their way, as `PassSums.to_bytes` has them."""
    return PassSumsPacket(
        job=job,
        pass_index=number,
        attempt=attempt,
        created=counts.created,
        retired=counts.retired,
        sent=counts.sent,
        received=counts.received,
        part_index=0,
        part_count=1,
        payload=payload,
    )
