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


def any_attempt(_original: Any) -> Any:
    """Packets count, whichever attempt they are of."""
    return lambda self, node, _attempt: (self.member(), self.place_of(node))


def never_seen_before(original: Any) -> Any:
    """What comes twice counts twice."""

    def take(self: Any, number: int, size: int, now: float) -> bool:
        original(self, number, size, now)
        return True

    return take


def up_to_the_newest(_original: Any) -> Any:
    """All is acknowledged up to the newest packet that came, whatever is missing before it."""

    def acknowledge(self: Any) -> tuple[int, bytes]:
        self.due_at, self._unsaid_packets, self._unsaid_bytes = None, 0, 0
        return self._all_until + self._above.bit_length(), b""

    return acknowledge


def unkept(original: Any) -> Any:
    """Films stay as they are when all of them have been gathered."""

    def forget_gathered(self: Any, gathering: int) -> None:
        passes, film = set(self.own.passes), self.own.__dict__.get("film")
        original(self, gathering)
        self.own.passes |= passes
        if film is not None:
            self.own.__dict__["film"] = film

    return forget_gathered


def adopted_twice(_original: Any) -> Any:
    """The copy of a node that is lost is ours, and stays its copy, too."""

    def adopt(self: Any, roster: Any) -> None:
        for node in [node for node in self._copies if node not in roster]:
            self.own.film.merge(self._copies[node].film)
            self.own.passes |= self._copies[node].passes

    return adopt


def wherever_they_come(original: Any) -> Any:
    """Rays are traced where they come, by whatever cells they were addressed."""

    def on_rays(self: Any, node: int, packet: Any) -> None:
        from dataclasses import replace

        original(self, node, replace(packet, partition_epoch=self.cell.partition.epoch))

    return on_rays


def done_again(original: Any) -> Any:
    """An attempt begins with all passes, also those that are in somebody's film."""

    def made(self: Any, cell: Any, stride: int, _done: Any) -> Any:
        return original(self, cell, stride, ())

    return made
