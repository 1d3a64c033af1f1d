"""The keys of a scene in memory: symmetric ones by epoch, and what vouches for its headers (specs/16-scene-log.md, Members)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Self

from scenefold.base.ids import SceneId
from scenefold.crypto import SYMMETRIC_KEY_BYTES, PublicKey
from scenefold.wire import Role

HEADER_SEED_BYTES = 32


class EpochKeys(Mapping[int, bytes]):
    """Symmetric keys by their epochs; never empty. Its repr shows no key."""

    __slots__ = ("_keys",)

    def __init__(self, keys: Mapping[int, bytes]) -> None:
        """ValueError if there is none, or one of another length."""
        if not keys or any(len(key) != SYMMETRIC_KEY_BYTES for key in keys.values()) or min(keys) < 0 or max(keys) >> 32:
            raise ValueError(f"keys of {SYMMETRIC_KEY_BYTES} bytes are expected, by epochs of 32 bits")
        self._keys = dict(sorted(keys.items()))

    @classmethod
    def only(cls, key: bytes, epoch: int = 0) -> Self:
        """One key."""
        return cls({epoch: key})

    @classmethod
    def of_rows(cls, rows: Iterable[Iterable[object]]) -> Self:
        """What `rows` gave; ValueError for anything else."""
        keys: dict[int, bytes] = {}
        for row in rows:
            epoch, key = row
            if type(epoch) is not int or not isinstance(key, bytes) or epoch in keys:
                raise ValueError("epoch and key are expected")
            keys[epoch] = key
        return cls(keys)

    def rows(self) -> list[list[int | bytes]]:
        """Plain values, in the order of the epochs."""
        return [[epoch, key] for epoch, key in self._keys.items()]

    @property
    def newest_epoch(self) -> int:
        return next(reversed(self._keys))

    @property
    def newest(self) -> bytes:
        return self._keys[self.newest_epoch]

    def merged(self, others: Mapping[int, bytes]) -> EpochKeys:
        """With the others besides; what is known already stays."""
        return self if others.keys() <= self._keys.keys() else EpochKeys({**others, **self._keys})

    def __getitem__(self, epoch: int) -> bytes:
        return self._keys[epoch]

    def __iter__(self) -> Iterator[int]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def __hash__(self) -> int:
        return hash(tuple(self._keys.items()))

    def __repr__(self) -> str:
        return f"EpochKeys(epochs={list(self._keys)})"


@dataclass(frozen=True, slots=True)
class SceneKeys:
    """What one member needs to read, write or vouch for a scene. `header_seed`: an owner's."""

    name: str
    genesis: bytes
    epochs: EpochKeys
    header_key: PublicKey
    role: Role
    header_seed: bytes | None = field(default=None, repr=False)

    @property
    def scene_id(self) -> SceneId:
        return SceneId(int.from_bytes(self.genesis[:4], "big"))
