"""If this fails, a log of many steps folds the slower the longer it is, or a space forgets or swaps some of its steps."""

from __future__ import annotations

from scenefold.scene.log.growing import Row, grown, items_of, row_of


def test_every_row_keeps_its_items_in_their_order_and_is_cut_the_same_way() -> None:
    rows: list[Row[int]] = [()]
    for item in range(300):
        rows.append(grown(rows[-1], item))
    for count, row in enumerate(rows):
        assert list(items_of(row)) == list(range(count))
        assert row_of(range(count)) == row
        assert [len(chunk) for chunk in row] == [1 << bit for bit in reversed(range(9)) if count >> bit & 1]


def test_an_item_is_copied_once_for_each_doubling() -> None:
    row: Row[int] = ()
    copied = 0
    for item in range(1 << 14):
        longer = grown(row, item)
        copied += sum(len(chunk) for chunk in longer if not any(chunk is old for old in row))
        row = longer
    assert copied <= (1 << 14) * 15
