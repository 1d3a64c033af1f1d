"""JSON that somebody wrote, value by value: what does not fit is DamagedData that says which key. Pure."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from scenefold.base.errors import DamagedData

_POSITION_MAX = 2**64 - 1


def told_json(data: bytes, where: str) -> object:
    try:
        return json.loads(data)
    except (ValueError, RecursionError) as problem:
        raise DamagedData(f"{where} is no JSON") from problem


class Told:
    """A map, and what must be in it."""

    def __init__(self, document: object, where: str) -> None:
        if not isinstance(document, dict):
            raise DamagedData(f"{where} is no map")
        self._document: dict[str, Any] = document
        self._where = where

    def get(self, key: str, *otherwise: Any) -> Any:
        if key not in self._document and not otherwise:
            raise DamagedData(f"{self._where} lacks {key!r}")
        return self._document.get(key, *otherwise)

    def whole(self, key: str, least: int, most: int = _POSITION_MAX) -> int:
        value = self.get(key)
        if type(value) is not int or not least <= value <= most:
            raise self._misfit(key)
        return value

    def text(self, key: str) -> str:
        value = self.get(key)
        if not isinstance(value, str):
            raise self._misfit(key)
        return value

    def flag(self, key: str) -> bool:
        value = self.get(key)
        if not isinstance(value, bool):
            raise self._misfit(key)
        return value

    def list(self, key: str) -> list[Any]:
        value = self.get(key)
        if not isinstance(value, list):
            raise self._misfit(key)
        return value

    def hex(self, key: str, size: int) -> bytes:
        try:
            value = bytes.fromhex(self.text(key))
        except ValueError:
            raise self._misfit(key) from None
        if len(value) != size:
            raise self._misfit(key)
        return value

    def floats(self, key: str, count: int) -> tuple[float, ...]:
        values = self.list(key)
        if len(values) != count:
            raise self._misfit(key)
        return self.numbers(values, key)

    def numbers(self, values: Sequence[Any], key: str) -> tuple[float, ...]:
        """Finite ones. JSON knows whole numbers that no float holds."""
        try:
            found = tuple(float(value) for value in values if type(value) in (int, float))
        except OverflowError:
            raise self._misfit(key) from None
        if len(found) != len(values) or not all(map(math.isfinite, found)):
            raise self._misfit(key)
        return found

    def _misfit(self, key: str) -> DamagedData:
        return DamagedData(f"{key!r} of {self._where} is not what it must be")
