"""Numbers that a program hands to our Python API: as plain floats and ints, or ValueError.

Those of other libraries are taken, too. `float` alone fails in three ways, and reads texts; `int` cuts fractions off.
"""

from __future__ import annotations

import operator
from typing import Any


def as_float(value: Any) -> float:
    """A number; a text is none, whatever it says."""
    if isinstance(value, (str, bytes, bytearray)):
        raise ValueError(f"{value[:40]!r} is no number")
    try:
        return float(value)
    except TypeError as problem:
        raise ValueError(f"a {type(value).__name__} is no number") from problem
    except OverflowError as problem:
        raise ValueError("a number is larger than any float") from problem


def as_floats(values: Any) -> tuple[float, ...]:
    """Numbers, as many as there are."""
    if isinstance(values, (str, bytes, bytearray)):
        raise ValueError(f"{values[:40]!r} is no row of numbers")
    try:
        each = iter(values)
    except TypeError as problem:
        raise ValueError(f"a {type(values).__name__} is no row of numbers") from problem
    return tuple(map(as_float, each))


def as_whole(value: Any) -> int:
    """A whole number; `True` is none."""
    if isinstance(value, bool):
        raise ValueError(f"{value} is no number")
    try:
        return operator.index(value)
    except TypeError as problem:
        raise ValueError(f"a {type(value).__name__} is no whole number") from problem
