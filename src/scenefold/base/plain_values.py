"""Plain values out of foreign documents: each is what it should be, or ValueError. Pure.

Nothing is converted: `int` fails on infinity in its own way, and `bytes` takes a number for a size.
"""

from __future__ import annotations

import math


def whole(value: object, least: int, most: int) -> int:
    """A whole number within bounds."""
    if type(value) is not int or not least <= value <= most:
        raise ValueError(f"a whole number from {least} to {most} is expected")
    return value


def exactly(value: object, length: int) -> bytes:
    """So many bytes."""
    if not isinstance(value, bytes) or len(value) != length:
        raise ValueError(f"{length} bytes are expected")
    return value


def flag(value: object) -> bool:
    """Yes or no."""
    if type(value) is not bool:
        raise ValueError("true or false is expected")
    return value


def text(value: object) -> str:
    """A text."""
    if not isinstance(value, str):
        raise ValueError("a text is expected")
    return value


def number(value: object) -> float:
    """A finite number, whole or not."""
    if type(value) is int and abs(value) < 1 << 53:
        return float(value)
    if type(value) is not float or not math.isfinite(value):
        raise ValueError("a finite number is expected")
    return value
