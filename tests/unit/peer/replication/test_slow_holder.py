"""If it fails, writers wait for the slowest of the disks that hold copies, though enough others have what they wrote."""

from __future__ import annotations

import trio

from unit.peer.replication.writers import Row, in_a_row, until


def test_a_holder_whose_disk_is_slow_is_waited_for_by_nobody() -> None:
    """It answers, so it is worse than one that is away: nothing would ever say that it is not to be waited for."""

    async def story(row: Row) -> None:
        await row.hold(1, 2)
        slow, commit_s = row.homes[2], 3.0
        row.net.machine(slow.address).disk.slow(commit_s)
        records = [row.next_at(place) for place in row.places(10)]
        begin = trio.current_time()
        for record in records:
            (outcome,) = await row.put(record)
            assert outcome.reason == 0
        assert trio.current_time() - begin < commit_s
        assert not any(slow.has(record) for record in records)
        await until(lambda: all(slow.has(record) for record in records))
        await until(lambda: not row.owner.debts())

    in_a_row(story)
