"""What can go wrong, by whose fault it is.

Our own bugs are AssertionErrors and the like, and stop us; a node that answers a packet goes on (world/serving.py). Everything else is a ScenefoldError with three parts: what
happened, where, and what to do about it; the command line prints them as one line.
"""

from __future__ import annotations

from typing import Any

from scenefold.base.reasons import RejectReason


class ScenefoldError(Exception):
    """Root of all errors that a user may see. `str()` is one line: what, where, remedy."""

    def __init__(self, what: str, *, where: str = "", remedy: str = "") -> None:
        super().__init__(what)
        self.what = what
        self.where = where
        self.remedy = remedy

    def __str__(self) -> str:
        place = f" ({self.where})" if self.where else ""
        remedy = f": {self.remedy}" if self.remedy else ""
        return f"{self.what}{place}{remedy}"

    def __reduce__(self) -> tuple[Any, ...]:
        """Whole in another process, too: what an exception is made of by itself is the first argument alone."""
        return _made_again, (type(self), self.args), dict(self.__dict__)


class LocalFault(ScenefoldError):
    """Our caller asked for what cannot be: a bad argument, file or setting."""


class UsageFault(LocalFault):
    """The command line or a setting is malformed (exit code 2)."""


class PeerFault(ScenefoldError):
    """Another node or client sent what it must not."""


class DamagedData(ScenefoldError):
    """Stored or transmitted data does not verify."""


class Unreachable(ScenefoldError):
    """The cluster, or the node that had to answer, did not (exit code 3)."""


class NotReached(Unreachable):
    """There was no connection, so nothing that was to be said has left."""


class TurnedAway(NotReached):
    """Somebody is there, but none of this cluster, or none that speaks as we do: no trying again mends that, and it tells more than silence."""


class Refused(ScenefoldError):
    """A node refused a request for a stated reason (exit code 4 where consensus or the mode forbids)."""

    def __init__(self, reason: RejectReason, what: str, *, where: str = "", remedy: str = "") -> None:
        super().__init__(what, where=where, remedy=remedy)
        self.reason = reason


class NoLease(Refused):
    """What was to be done takes a lease, which nobody lends just now, or which is over. `was_held`: it was lent, and was not renewed in time."""

    def __init__(self, reason: RejectReason, what: str, *, where: str = "", remedy: str = "", was_held: bool = False) -> None:
        super().__init__(reason, what, where=where, remedy=remedy)
        self.was_held = was_held


def _made_again(kind: type[ScenefoldError], args: tuple[Any, ...]) -> ScenefoldError:
    return kind.__new__(kind, *args)
