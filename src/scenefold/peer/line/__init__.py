"""The node's place on the line: its arc, handovers to neighbours, adoption of gaps, strays (specs/12-line.md)."""

from scenefold.peer.line.claims import Claims
from scenefold.peer.line.ends import Side
from scenefold.peer.line.gaps import Gaps
from scenefold.peer.line.holding import Handover, Step
from scenefold.peer.line.line import Line, Remaining

__all__ = ["Claims", "Gaps", "Handover", "Line", "Remaining", "Side", "Step"]
