"""What a node adds up of each pass that is open anywhere, by thread (specs/08-passes.md, *Sums of a pass on a node*)."""

from __future__ import annotations

from scenefold.render.ledger import Counts
from scenefold.render.pass_sums import PassSums
from scenefold.render.passes import PassPlan
from scenefold.render.sum_columns import SumColumns
from scenefold.wire import PassSums as PassSumsPacket


class KeptSums:
    """Of one node in one attempt. A pass's are complete once no ray of it is under way anywhere; until then its threads add to them."""

    def __init__(self, plan: PassPlan, columns: SumColumns) -> None:
        self._plan, self._columns = plan, columns
        self._kept: dict[int, dict[int, PassSums]] = {}

    def __len__(self) -> int:
        """Of so many passes something is kept."""
        return len(self._kept)

    def none_of(self, number: int) -> PassSums:
        """Zeros, for a pass."""
        return PassSums.zeros(self._plan.size(number), self._columns)

    def of_thread(self, number: int, thread: int) -> PassSums:
        """Where a thread adds what it traces of a pass."""
        by_thread = self._kept.setdefault(number, {})
        if thread not in by_thread:
            by_thread[thread] = self.none_of(number)
        return by_thread[thread]

    def total(self, number: int) -> PassSums:
        """Of all threads. In a worker; of a pass that no thread traces."""
        by_thread = list(self._kept.get(number, {}).values())
        if len(by_thread) == 1:
            return by_thread[0]
        total = self.none_of(number)
        for sums in by_thread:
            total.add(sums)
        return total

    def packed(self, number: int) -> bytes:
        """The same, for the pass's owner."""
        return self.total(number).to_bytes()

    def forget(self, number: int) -> None:
        """A pass is closed."""
        self._kept.pop(number, None)


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
