"""An open store, as all of its calls need it: readers' views, and the writer."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Concatenate, ParamSpec, TypeVar

from scenefold.store.sealing import StoreDamaged
from scenefold.store.writer import GroupWriter
from scenefold.world.ports import Environment, ReadTransaction, Workers

P = ParamSpec("P")
T = TypeVar("T")


class OpenedStore:
    """What parts of the store have in common."""

    def __init__(self, workers: Workers, environment: Environment, writer: GroupWriter) -> None:
        self._workers = workers
        self._environment = environment
        self._writer = writer

    async def _view(self, function: Callable[Concatenate[ReadTransaction, P], T], *args: P.args, **options: P.kwargs) -> T:
        """Call a function with an unchanging view of the tables, in a reading thread. StoreDamaged ends the store."""
        try:
            return await self._workers.run("store-read", partial(in_view, self._environment, function, *args, **options))
        except StoreDamaged as damage:
            self._writer.halt(damage)
            raise


def in_view(environment: Environment, function: Callable[Concatenate[ReadTransaction, P], T], *args: P.args, **options: P.kwargs) -> T:
    with environment.read() as transaction:
        return function(transaction, *args, **options)
