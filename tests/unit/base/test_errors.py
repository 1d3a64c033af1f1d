"""If this fails, an error of another process comes without what it was about, or as another one."""

from __future__ import annotations

import pickle

import pytest

from scenefold.base.errors import DamagedData, LocalFault, NotReached, PeerFault, Refused, ScenefoldError, Unreachable, UsageFault
from scenefold.base.reasons import RejectReason


@pytest.mark.parametrize("kind", [LocalFault, UsageFault, PeerFault, DamagedData, Unreachable, NotReached])
def test_an_error_is_whole_in_another_process(kind: type[ScenefoldError]) -> None:
    error = pickle.loads(pickle.dumps(kind("it is none", where="a.glb", remedy="give another")))
    assert type(error) is kind and str(error) == "it is none (a.glb): give another"
    assert (error.what, error.where, error.remedy) == ("it is none", "a.glb", "give another")


def test_a_refusal_keeps_its_reason() -> None:
    error = pickle.loads(pickle.dumps(Refused(RejectReason.BUSY, "no place", where="127.0.0.2", remedy="wait")))
    assert type(error) is Refused and error.reason is RejectReason.BUSY and str(error) == "no place (127.0.0.2): wait"
