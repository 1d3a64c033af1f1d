"""If this fails, who needs a node that is away is not told when the same command does what it could not do now."""

from __future__ import annotations

import pytest

from scenectl.waiting import going_on
from scenefold.base.errors import LocalFault, Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason

BACK = "once who is away is back, or has been removed, which takes two minutes of silence, render again"


@pytest.mark.parametrize(
    ("problem", "remedy"),
    [
        (Unreachable("no answer", remedy="see that it runs"), f"see that it runs; {BACK}"),
        (Refused(RejectReason.NOT_READY, "the owner does not answer"), BACK),
        (Refused(RejectReason.NOT_AUTHORISED, "no", remedy="ask an owner"), "ask an owner"),
        (LocalFault("no such file", remedy="name another"), "name another"),
    ],
)
def test_an_error_of_a_node_that_is_away_says_when_to_come_again(problem: ScenefoldError, remedy: str) -> None:
    with pytest.raises((ScenefoldError, ExceptionGroup)), going_on("render again"):
        raise ExceptionGroup("of a nursery", [problem]) if remedy == BACK else problem
    assert problem.remedy == remedy
