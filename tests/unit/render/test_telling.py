"""If this fails, a user hears that a render failed, but not why, or under the wrong exit code."""

from __future__ import annotations

import pytest

from scenectl.errors import FAILED, UNREACHABLE, ending_of
from scenefold.base.errors import DamagedData, LocalFault, PeerFault, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.render.pool.telling import error_of, failure_fields, reason_of, told, words_of
from scenefold.wire import JobAnswer, decode_packet, encode_packet

ERRORS = [
    (LocalFault("no camera 'attic'", where="camera", remedy="choose 'main'"), FAILED),
    (PeerFault("a packet of rays is ill-formed", where="pass 7"), FAILED),
    (DamagedData("the scene changed", remedy="start again"), FAILED),
    (Refused(RejectReason.LIMIT_EXCEEDED, "too much", where="127.0.0.2"), FAILED),
    (Refused(RejectReason.BUSY, "as many jobs as it may"), UNREACHABLE),
    (Unreachable("the node does not answer", where="127.0.0.3"), UNREACHABLE),
]


@pytest.mark.parametrize(("error", "code"), ERRORS, ids=[type(error).__name__ for error, _ in ERRORS])
def test_an_error_arrives_as_it_left(error: ScenefoldError, code: int) -> None:
    answer = decode_packet(encode_packet(JobAnswer(job=1, reason=int(reason_of(error)), text=words_of(error))))
    assert isinstance(answer, JobAnswer)
    heard = error_of(answer.reason, answer.text)
    assert (heard.what, heard.where, heard.remedy) == (error.what, error.where, error.remedy)
    assert str(told(error)) == str(heard)
    assert ending_of(heard).exit_code == code


def test_what_is_said_fits_its_packet_and_stays_in_line() -> None:
    error = LocalFault("ü" * 5_000, where="a\nb\nc", remedy="é" * 5_000)
    answer = decode_packet(encode_packet(JobAnswer(job=1, reason=7, text=words_of(error))))
    assert isinstance(answer, JobAnswer)
    assert error_of(answer.reason, answer.text).where == "a b c"


def test_what_no_node_of_ours_would_say_is_still_an_error() -> None:
    heard = error_of(0, "", where="127.0.0.2", before="the render failed: ")
    assert str(heard) == "the render failed: no reason is given (127.0.0.2)"
    assert error_of(255, "one\ntwo\nthree\nfour").remedy == "three"


def test_no_failure_is_no_words() -> None:
    assert failure_fields(None) == {"failure": "", "failure_reason": 0}
