"""If this fails, `render fetch` ends as an error though its image is written."""

from __future__ import annotations

from typing import Any

import pytest
import trio

from scenectl.unattended import _let_go
from scenefold.base.errors import Refused, ScenefoldError, Unreachable
from scenefold.base.reasons import RejectReason
from scenefold.render import unattended


@pytest.mark.parametrize("error", [Unreachable("no answer"), Refused(RejectReason.NOT_READY, "no such job")])
async def test_that_a_node_is_gone_is_no_fault_of_what_it_gave(
    error: ScenefoldError, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    async def fails(*_: object) -> None:
        await trio.lowlevel.checkpoint()
        raise error

    monkeypatch.setattr(unattended, "end_render", fails)
    nothing: Any = None
    await _let_go(nothing, nothing)
    assert capsys.readouterr().err == f"note: the image is written, and its node could not be told to forget it: {error}\n"
