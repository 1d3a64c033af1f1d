"""What ends a command: exit codes, and any error as one line that says what, where, and what to do (ux.md, *scenectl*).

The line is made from the error itself, never from a traceback; `--debug` shows that as well. Trio wraps what
fails in a nursery into groups, of which the user sees the one error that tells most.
"""

from __future__ import annotations

import errno
import re
from dataclasses import dataclass
from types import TracebackType

from scenefold.base.errors import LocalFault, PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.ids import NodeId, address_of
from scenefold.base.reasons import RejectReason
from scenefold.client.requests import InDoubt

DONE = 0
FAILED = 1
WRONG_USAGE = 2
UNREACHABLE = 3
REFUSED = 4
DEGRADED = 5
INTERRUPTED = 130
"""What shells give a program that ended by SIGINT (128 + 2)."""
READER_LEFT = 141
"""What shells give a program whose reader went away, as `head` does (SIGPIPE, 128 + 13)."""

STANDARD_OUTPUT = "standard output"

_REFUSALS = {
    RejectReason.POSITION_TAKEN: REFUSED,
    RejectReason.POSITION_BEHIND: REFUSED,
    RejectReason.PEER_MISSED: REFUSED,
    RejectReason.STALE_VERSION: REFUSED,
    RejectReason.MODE_FORBIDS: REFUSED,
    RejectReason.NOT_AUTHORISED: REFUSED,
    RejectReason.NO_MAJORITY: REFUSED,
    RejectReason.KEY_REVOKED: REFUSED,
    RejectReason.NOT_READY: UNREACHABLE,
    RejectReason.BUSY: UNREACHABLE,
}
"""Reasons by which consensus, the mode or another's record forbids, or behind which a node is away; the others are failures."""


NODE_ID_MAX = 2**32 - 1
_NODE_NAME = re.compile(r"(?<![\w'\"])node:(0|[1-9][0-9]{0,9})(?!\.?[0-9])")
"""Not in quotes: what stands there is what somebody called a scene or a space."""


class Interrupted(Exception):
    """The user pressed Ctrl-C, or the process was told to end by another signal; everything was stopped in order."""

    def __init__(self, signal_number: int = 2) -> None:
        super().__init__(signal_number)
        self.signal_number = signal_number
        self.what, self.where, self.remedy = "interrupted", "", "the same command may be given again"
        self.request = ""
        """Of a change that may have been made."""


@dataclass(frozen=True)
class Ending:
    """How a command ended badly."""

    kind: str
    exit_code: int
    what: str
    where: str = ""
    remedy: str = ""
    request: str = ""
    """Of a change of a scene of which nobody knows."""
    reason: str = ""
    """Of a refusal, as specs/03-wire.md names it (Reasons)."""

    @property
    def line(self) -> str:
        return " ".join(str(ScenefoldError(self.what, where=self.where, remedy=self.remedy)).split())

    def document(self) -> dict[str, object]:
        """The JSON form: stable, see docs/reference/scenectl.md."""
        error = {"kind": self.kind, "what": self.what, "where": self.where, "remedy": self.remedy}
        if self.request:
            error["request"] = self.request
        if self.reason:
            error["reason"] = self.reason
        return {"error": error, "exit_code": self.exit_code}


def ending_of(error: BaseException) -> Ending:
    """The exit code and the words for an error that no verb handled."""
    error = most_telling(error)
    match error:
        case Interrupted():
            return Ending("interrupted", INTERRUPTED, error.what, error.where, error.remedy, error.request)
        case KeyboardInterrupt():
            return Ending("interrupted", INTERRUPTED, "interrupted", remedy="the same command may be given again")
        case UsageFault():
            return _ending("usage", WRONG_USAGE, error)
        case Unreachable():
            return _ending("unreachable", UNREACHABLE, error)
        case Refused():
            return _ending("refused", _REFUSALS.get(error.reason, FAILED), error)
        case PeerFault():
            return _ending("peer", FAILED, error)
        case LocalFault():
            return _ending("failed", FAILED, error)
        case ScenefoldError():
            return _ending("damaged", FAILED, error)
        case MemoryError():
            return Ending("failed", FAILED, "out of memory", remedy="use a machine with more, or a smaller scene")
        case OSError():
            where = str(error.filename or (STANDARD_OUTPUT if _is_of_a_page(error) else "this computer"))
            return Ending("failed", FAILED, error.strerror or str(error), where=where, remedy=_remedy_of(error, where))
        case _:
            return Ending(
                "bug",
                FAILED,
                f"internal error, {type(error).__name__}: {error}",
                where=_place_of(error),
                remedy="repeat with --debug and report what it prints",
            )


def reader_left(error: BaseException) -> bool:
    """Whether all that happened is that nobody reads our output any more."""
    told = most_telling(error)
    # rich, which prints pages of help, makes an exit of it.
    return isinstance(told.__context__ if isinstance(told, SystemExit) else told, BrokenPipeError)


def most_telling(error: BaseException) -> BaseException:
    """The one error of a group (of groups) to show: our own kinds before others, the first before the rest."""
    leaves = list(_leaves(error))
    ours = [leaf for leaf in leaves if isinstance(leaf, ScenefoldError | Interrupted | KeyboardInterrupt)]
    return (ours or leaves)[0]


def _leaves(error: BaseException) -> list[BaseException]:
    if not isinstance(error, BaseExceptionGroup):
        return [error]
    return [leaf for inner in error.exceptions for leaf in _leaves(inner)]


def _ending(kind: str, exit_code: int, error: ScenefoldError) -> Ending:
    request = str(error.request) if isinstance(error, InDoubt) else ""
    what, where, remedy = map(with_addresses, (error.what, error.where, error.remedy))
    return Ending(kind, exit_code, what, where, remedy, request, error.reason.name.lower() if isinstance(error, Refused) else "")


def with_addresses(text: str) -> str:
    """Words that may be a node's, which knows the others by number, with their addresses, by which people know them."""
    return _NODE_NAME.sub(_with_address, text)


def _with_address(name: re.Match[str]) -> str:
    number = int(name[1])
    return f"node:{address_of(NodeId(number))}" if number <= NODE_ID_MAX else name[0]


def _is_of_a_page(error: OSError) -> bool:
    """Whether rich failed to print it, as it does pages of help."""
    trace = _innermost(error)
    return trace is not None and _module_of(trace).startswith("rich.")


def _remedy_of(error: OSError, where: str) -> str:
    if where == STANDARD_OUTPUT:
        return "send it to where there is room, or to /dev/null"
    if error.errno in (errno.ENOSPC, errno.EDQUOT):
        return "make room, and give the same command again"
    if error.errno == errno.ENAMETOOLONG:
        return "give a shorter name"
    return "see what is there, and give the same command again"


def _place_of(error: BaseException) -> str:
    trace = _innermost(error)
    return "" if trace is None else f"{_module_of(trace)}, line {trace.tb_lineno}"


def _innermost(error: BaseException) -> TracebackType | None:
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace


def _module_of(trace: TracebackType) -> str:
    return str(trace.tb_frame.f_globals.get("__name__", "?"))
