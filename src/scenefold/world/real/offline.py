"""A world without a network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NoReturn

from scenefold.world.ports import Connection, Datagrams, Endpoint


class NoNetwork:
    """Whoever asks it for something has the wrong world."""

    turned_away = 0

    async def listen(self, *_: object, **__: object) -> NoReturn:
        raise AssertionError("this world has no such network")

    connect = listen
    open_datagrams = listen
    hear_broadcasts = listen

    async def approach(self, _address: str, /) -> tuple[Connection, bytes]:
        raise AssertionError("this world has no network")

    async def open_broadcasts(self) -> tuple[Datagrams, Sequence[Endpoint]]:
        raise AssertionError("this world has no network")

    def show(self, _certificate: bytes, /) -> NoReturn:
        raise AssertionError("this world has no network")
