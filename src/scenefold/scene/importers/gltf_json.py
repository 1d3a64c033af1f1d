"""Typed access to a glTF's JSON: whatever the file holds in a place, a reader gets the type it asked for,
or a LocalFault that names the place, such as `accessors[3].count`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

from scenefold.base.errors import LocalFault
from scenefold.scene.importers.faults import bad_file

JSON_BYTES_MAX = 64 * 1024 * 1024
"""Parsed, JSON takes about ten times its size; more than this is data that belongs in buffers."""


def parse_json(path: Path, text: bytes) -> JsonMap:
    """The top-level object."""
    if len(text) > JSON_BYTES_MAX:
        raise bad_file(path, f"its JSON has {len(text)} bytes, more than {JSON_BYTES_MAX}", "put data into buffers")
    try:
        value = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as error:
        raise bad_file(path, f"its JSON cannot be read, {error}") from error
    return JsonMap(path, "", value)


class JsonMap:
    """One JSON object at a known place of the file."""

    def __init__(self, path: Path, place: str, value: Any) -> None:
        self._path = path
        self._place = place
        if not isinstance(value, dict):
            raise self.fault("is no object")
        self._value: dict[str, Any] = value

    def fault(self, what: str, key: str = "") -> LocalFault:
        """The error for this place (or for a key of it)."""
        return bad_file(self._path, f"{self._name(key) or 'the top level'} {what}")

    def _name(self, key: str) -> str:
        return f"{self._place}.{key}" if self._place and key else self._place or key

    def has(self, key: str) -> bool:
        return key in self._value

    def keys(self) -> list[str]:
        return list(self._value)

    def integer(self, key: str, low: int = 0, high: int = 2**53, default: int | None = None) -> int:
        value = self._value.get(key, default)
        # 3.0 is a whole number in JSON.
        if isinstance(value, float) and value.is_integer():
            value = int(value)
        if type(value) is not int:
            raise self.fault("is missing" if value is None else "is no whole number", key)
        if not low <= value <= high:
            raise self.fault(f"is {value}, not within {low} to {high}", key)
        return value

    def index(self, key: str, count: int, what: str) -> int:
        """A number of one of `count` things; -1 if the key is absent."""
        if key not in self._value:
            return -1
        value = self.integer(key, -(2**53))
        if not 0 <= value < count:
            raise self.fault(f"names {what} {value}, but there are {count}", key)
        return value

    def number(self, key: str, default: float | None = None) -> float:
        return self._number(self._value.get(key, default), key)

    def _number(self, value: Any, key: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.fault("is missing" if value is None else "is no number", key)
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.fault("is not finite", key)
        return number

    def unit(self, key: str, default: float) -> float:
        """A factor, moved into 0 to 1."""
        return min(max(self.number(key, default), 0.0), 1.0)

    def numbers(self, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
        """As many numbers as `default` has."""
        if key not in self._value:
            return default
        values = self._value[key]
        if not isinstance(values, list) or len(values) != len(default):
            raise self.fault(f"is no list of {len(default)} numbers", key)
        return tuple(self._number(value, key) for value in values)

    def row(self, key: str) -> tuple[float, ...]:
        """Any number of numbers; none if the key is absent."""
        return tuple(self._number(value, key) for value in self._list(key))

    def text(self, key: str, default: str | None = None) -> str:
        value = self._value.get(key, default)
        if not isinstance(value, str):
            raise self.fault("is missing" if value is None else "is no text", key)
        return value

    def flag(self, key: str) -> bool:
        value = self._value.get(key, False)
        if not isinstance(value, bool):
            raise self.fault("is neither true nor false", key)
        return value

    def inner(self, key: str) -> JsonMap:
        """An object; empty if the key is absent."""
        return JsonMap(self._path, self._name(key), self._value.get(key, {}))

    def extension(self, name: str) -> JsonMap | None:
        extensions = self.inner("extensions")
        return extensions.inner(name) if extensions.has(name) else None

    def _list(self, key: str) -> list[Any]:
        values = self._value.get(key, [])
        if not isinstance(values, list):
            raise self.fault("is no list", key)
        return values

    def maps(self, key: str) -> list[JsonMap]:
        """A list of objects; empty if the key is absent."""
        name = self._name(key)
        return [JsonMap(self._path, f"{name}[{at}]", value) for at, value in enumerate(self._list(key))]

    def indices(self, key: str, count: int, what: str) -> list[int]:
        """A list of numbers of things of which there are `count`."""
        values = self._list(key)
        for value in values:
            whole = type(value) is int or (type(value) is float and value.is_integer())
            if not whole or not 0 <= value < count:
                raise self.fault(f"names {what} {value!r}, but there are {count}", key)
        return [int(value) for value in values]

    def texts(self, key: str) -> list[str]:
        values = self._list(key)
        if not all(isinstance(value, str) for value in values):
            raise self.fault("is no list of texts", key)
        return values
