"""How long a node holds a place for a part of which nobody speaks (specs/19-jobs.md, Places). Pure.

It counts its own looks and not seconds, so a node that stood still itself, and so heard nobody, ends nothing for that.
"""

from __future__ import annotations

PREPARE_S_MAX = 900.0
"""So long may the nodes of a job prepare."""
LOOK_S = 5.0
SILENT_LOOKS_MAX = 12
"""The organiser speaks many times in so many looks; if it does not, it died, or was cut off, or wants no image."""
QUIET_LOOKS = 3
"""Who was silent for so many looks has most likely died: its places go to jobs that have none, and only to these."""
WAITING_LOOKS_MAX = int(PREPARE_S_MAX / LOOK_S) + SILENT_LOOKS_MAX
WORD_S = 3.0
"""The organiser's pause between two words to each node."""


class Hold:
    """Of one part."""

    def __init__(self) -> None:
        self._silent = 0
        self._waiting: int | None = 0

    def heard(self) -> None:
        """The organiser said something."""
        self._silent = 0

    def go(self) -> None:
        """It said that the part may trace."""
        self._silent, self._waiting = 0, None

    @property
    def is_quiet(self) -> bool:
        """Whether the organiser has said nothing for a while, so that the place is for whoever needs one."""
        return self._silent >= QUIET_LOOKS

    def over(self) -> str:
        """One more look: why the place is held no longer; empty as long as it is."""
        self._silent += 1
        if self._waiting is not None:
            self._waiting += 1
            if self._waiting > WAITING_LOOKS_MAX:
                return "never said that it begins"
        return "is silent" if self._silent > SILENT_LOOKS_MAX else ""
