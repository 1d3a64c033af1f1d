"""What takes the place of a safeguard of renders in a mutant (mutants.py)."""

from __future__ import annotations

from typing import Any


def first_reading_is_enough(_original: Any) -> Any:
    """A pass is closed as soon as counts balance that were not taken at one moment."""

    def collected(self: Any, node: int, counts: Any) -> Any:
        from scenefold.render.ledger import PassState

        self._second[node] = counts
        if all(reading is not None for reading in self._second):
            self.state = PassState.CLOSED
        return self.state

    return collected


def without_a_node(original: Any) -> Any:
    """Who closes a pass does not wait for the sums of the last node that has some."""

    def close(self: Any, number: int, payloads: list[bytes]) -> Any:
        return original(self, number, payloads[:-1])

    return close


def wherever_they_come(original: Any) -> Any:
    """Rays are traced where they come, by whatever cells they were addressed."""

    def on_rays(self: Any, node: int, packet: Any) -> None:
        from dataclasses import replace

        epoch = self.cell.epoch
        original(self, node, replace(packet, batches=tuple(replace(batch, partition_epoch=epoch) for batch in packet.batches)))

    return on_rays


def however_often_it_comes(original: Any) -> Any:
    """What comes on a link counts, also if it came before."""

    def is_new(self: Any, number: int, size: int) -> bool:
        original(self, number, size)
        return True

    return is_new


def kept_beside(_original: Any) -> Any:
    """A node keeps its film when all of that is the organiser's, and hands it on once more the next time."""

    def forget_gathered(self: Any, gathering: int) -> None:
        if gathering > self._gathered:
            self._gathered, self._coming = gathering, None

    return forget_gathered


def held_for_ever(_original: Any) -> Any:
    """A client does not say that it wants an image no more."""

    async def let_go(_self: Any) -> None:
        import trio

        await trio.lowlevel.checkpoint()

    return let_go
