"""What decoding and encoding raise (specs/03-wire.md, Encoding); of what a peer sent, MalformedPacket alone.

Whatever a stranger sends, the answer of this room is a packet or a MalformedPacket: it names the field and,
where the array's head could still be read, the request id, so that the sender gets a typed Fault and not a
dropped connection.
"""

from __future__ import annotations

from scenefold.base.errors import PeerFault, Refused
from scenefold.base.reasons import RejectReason


class MalformedPacket(PeerFault):
    """What arrived is no packet of ours. `field` is a path such as "PutMany.items[3].location". `unknown`: a number that says what follows, where
    this version knows none such."""

    def __init__(self, field: str, problem: str, *, request_id: int | None = None, unknown: int | None = None) -> None:
        super().__init__(f"malformed packet: {problem}", where=field)
        self.field = field
        self.problem = problem
        self.request_id = request_id
        self.unknown = unknown


class UnknownEntry(MalformedPacket):
    """A record of a log whose entry is of a kind that this version of scenefold does not know yet."""

    def __init__(self, field: str, number: int) -> None:
        super().__init__(field, f"unknown entry {number}", unknown=number)
        self.what = f"it holds an entry of a kind that this program does not know ({number}), so a newer program wrote it"
        self.remedy = "update this program"


class UnsupportedPacket(MalformedPacket):
    """The packet's number is reserved, but this version of scenefold does not know it yet."""

    def __init__(self, number: int, name: str, *, request_id: int | None = None) -> None:
        super().__init__("type", f"not supported: {number} {name}", request_id=request_id)
        self.number = number


class NotSpoken(Refused):
    """The version of the connection has no such packet, so it is not sent. Who asks hears what a peer would answer that got it."""

    def __init__(self, name: str, version: int) -> None:
        what, remedy = f"not supported: {name} is no packet of version {version}", "upgrade the program of the peer"
        super().__init__(RejectReason.ILL_FORMED, what, remedy=remedy)


class Misfit(Exception):
    """A value or its bytes do not fit their kind. Never leaves this package: the codec adds where and by whose fault."""

    def __init__(self, problem: str, path: str = "", *, unknown: int | None = None) -> None:
        super().__init__(problem)
        self.problem = problem
        self.path = path
        self.unknown = unknown

    def inside(self, outer: str) -> Misfit:
        """The same misfit, seen from one container further out."""
        return Misfit(self.problem, outer + self.path, unknown=self.unknown)
