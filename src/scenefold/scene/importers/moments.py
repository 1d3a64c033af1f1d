"""The moment at which a scene file that moves is imported (specs/05-scene-content.md, *Moments*)."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scenefold.base.errors import UsageFault

TIME_S_MAX = 1e6
"""Eleven days: beyond that, keyframes in f32 are a sixteenth of a second apart."""
FPS_USUAL = 24.0


@dataclass(frozen=True, slots=True)
class Moment:
    """A time of a file's animations, in seconds from 0 to `TIME_S_MAX`; UsageFault for another."""

    time_s: float | None = None
    """None: at rest, as the file's nodes stand without any animation."""
    animation: str | None = None
    """The name of the one that plays; None: all do."""

    def __post_init__(self) -> None:
        if self.time_s is None:
            if self.animation is not None:
                raise UsageFault("an animation is named, but no time of it", where=self.animation, remedy="give a time or a frame, too")
        elif not (math.isfinite(self.time_s) and 0.0 <= self.time_s <= TIME_S_MAX):
            raise UsageFault(f"the time is {self.time_s}", where="time", remedy=f"give seconds from 0 to {TIME_S_MAX:.0f}")

    def named(self, file: str) -> str:
        """What a scene of this file at this moment is called in its document."""
        if self.time_s is None:
            return file
        playing = "" if self.animation is None else f" of {self.animation}"
        return f"{file} at {self.time_s:.6g} s{playing}"


AT_REST = Moment()


def moment_of_frame(frame: int, fps: float = FPS_USUAL, animation: str | None = None) -> Moment:
    """The moment of frame `frame` (from 0 on) at `fps` frames a second; UsageFault if one of them is out of range."""
    if not (math.isfinite(fps) and 0.0 < fps <= 1e6):
        raise UsageFault(f"fps is {fps}", where="fps", remedy="give frames a second, above 0 and up to 1000000")
    return Moment(frame / fps, animation)
