"""What a voter does before it promises, votes or grants in a process: it asks the other voters under its life (specs/26-modes.md, A voter's
own disk). Pure.

A disk that was put back has forgotten votes, which consensus does not stand. The other voters tell it by its life, mostly.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from scenefold.consensus import Participants
from scenefold.wire import Member


@dataclass(frozen=True, slots=True)
class Awakening:
    """In memory, from the start of a process on. Once awake it stays so, whoever comes and goes."""

    answers: Mapping[Member, bool] = field(default_factory=lambda: MappingProxyType({}))
    """Of other voters: False: it knows of a later life."""
    is_awake: bool = False

    @property
    def is_over(self) -> bool:
        """Somebody knows of a later life: this disk is an older one, and its node begins anew."""
        return not self.is_awake and not all(self.answers.values())

    def answered(self, voter: Member, *, is_refused: bool) -> Awakening:
        """A grant, or none, or a refusal with 18 of what was asked under this node's life. Who refuses otherwise has not looked at the life."""
        return self if self.is_awake else replace(self, answers={**self.answers, voter: not is_refused})

    def looked_at(self, voters: Participants, me: Member) -> Awakening:
        """Whether so many have answered that with this node they are a majority. To be called after each answer and whenever the log goes on."""
        others = [voter for voter, _ in self.answers.items() if voter in voters and voter != me]
        if self.is_over or me not in voters or 1 + len(others) < voters.majority:
            return self
        return replace(self, is_awake=True)
