"""If this fails, users see tracebacks, or scripts read a wrong exit code."""

from __future__ import annotations

import pytest

from scenectl.errors import Interrupted, ending_of
from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason

CODES = [
    (UsageFault("w"), 2),
    (LocalFault("w"), 1),
    (Unreachable("w"), 3),
    (PeerFault("w"), 1),
    (DamagedData("w"), 1),
    (Refused(RejectReason.MODE_FORBIDS, "w"), 4),
    (Refused(RejectReason.NO_MAJORITY, "w"), 4),
    (Refused(RejectReason.NOT_AUTHORISED, "w"), 4),
    (Refused(RejectReason.STORAGE_FULL, "w"), 1),
    (KeyboardInterrupt(), 130),
    (Interrupted(), 130),
    (OSError(28, "No space left on device", "/x"), 1),
    (MemoryError(), 1),
    (ZeroDivisionError("division by zero"), 1),
]


@pytest.mark.parametrize(("error", "code"), CODES, ids=lambda value: getattr(value, "args", value))
def test_exit_codes(error: BaseException, code: int) -> None:
    assert ending_of(error).exit_code == code
    assert ending_of(BaseExceptionGroup("in a nursery", [error])).exit_code == code


def test_the_line_says_what_where_and_what_to_do() -> None:
    ending = ending_of(LocalFault("the port\nis taken", where="127.0.0.2:17349", remedy="stop the other node"))
    assert ending.line == "the port is taken (127.0.0.2:17349): stop the other node"


def test_of_a_group_the_telling_error_is_shown() -> None:
    group = BaseExceptionGroup("", [ValueError("x"), BaseExceptionGroup("", [Unreachable("no node answers")])])
    assert ending_of(group).what == "no node answers"


def test_our_own_bugs_ask_for_a_report() -> None:
    ending = ending_of(ZeroDivisionError("division by zero"))
    assert ending.kind == "bug"
    assert "--debug" in ending.remedy
