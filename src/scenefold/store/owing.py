"""What nodes that hold copies ask their stores for, so that all get them (specs/10-store.md, Debts; 20-copies.md, Writes)."""

from __future__ import annotations

from collections.abc import Sequence

from scenefold.base.ids import NodeId
from scenefold.store.debts import Debt, DebtPage, read_debts, read_debts_of
from scenefold.store.layout import Spot
from scenefold.store.opened import OpenedStore
from scenefold.store.record_changes import PayDebts


class OwingStore(OpenedStore):
    """The part of the store that knows who is still to get what is here. Versions are those of `version_of`."""

    async def debts(self, after: bytes | None, limit: int) -> DebtPage:
        """The first `limit` >= 1 debts behind the cursor, in the order of scene, space, location, object."""
        assert limit >= 1
        return await self._view(read_debts, after, limit)

    async def debtors_of(self, spots: Sequence[Spot]) -> list[tuple[NodeId, ...]]:
        """Who is still to get what lies at each spot; nobody if nothing lies there."""
        return [() if debt is None else debt.nodes for debt in await self.debts_of(spots)]

    async def debts_of(self, spots: Sequence[Spot]) -> list[Debt | None]:
        """Likewise, and of which version that is; None where nothing is owed."""
        return await self._view(read_debts_of, spots)

    async def paid(self, items: Sequence[tuple[Spot, bytes, NodeId]]) -> None:
        """These nodes have these versions: durable with the next commit, in a second at most, and not by itself before.

        Of another version than the one that is here it changes nothing. It is forgotten in a crash, and must be said again then.
        """
        if items:
            await self._writer.ride_along(PayDebts(list(items)))

    @property
    def owed(self) -> dict[NodeId, int]:
        """How many records each node is still to get, as of the last commit, without a look at the disk."""
        return {node: count for node, count in self._writer.owed.items() if count}
