"""A node's records are read again, all of them and all the time, so that what rots is found while others still have it (specs/21-verify.md, Scrub)."""

from scenefold.peer.scrub.pace import Pace, Progress
from scenefold.peer.scrub.scrub import Scrub

__all__ = ["Pace", "Progress", "Scrub"]
