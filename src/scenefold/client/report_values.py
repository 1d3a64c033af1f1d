"""Single values of what nodes say of themselves: each is what it should be, or ValueError. Pure.

What is printed could else write lines of others, or move a terminal's cursor.
"""

from __future__ import annotations

from typing import Any

from scenefold.base.ids import address_of, checked_node_id
from scenefold.base.location import Location
from scenefold.base.plain_values import number, whole

COUNT_MAX = 2**63 - 1
AMOUNT_MAX = 1e30
"""No time is longer, and no line of a table either."""


def told_address(value: object) -> str:
    """A node's."""
    return address_of(checked_node_id(str(value)))


def told_word(value: object) -> str:
    """What is printed as it is: no line ends, nor what moves a terminal's cursor."""
    text = str(value)
    if not text.isprintable():
        raise ValueError("a word is expected")
    return text


def told_map(value: object) -> dict[str, Any]:
    if not isinstance(value, dict):
        raise ValueError("a map is expected")
    return value


def told_location(text: str) -> Location:
    return Location(bytes.fromhex(text))


def told_seconds(value: object) -> float | None:
    """A time that there need not be."""
    return None if value is None else told_amount(value)


def told_count(value: object) -> int:
    return whole(value, 0, COUNT_MAX)


def told_amount(value: object) -> float:
    """A time, or a part of something: what can be laid out in a table and counted with."""
    amount = number(value)
    if abs(amount) > AMOUNT_MAX:
        raise ValueError(f"a number up to {AMOUNT_MAX:g} is expected")
    return amount
