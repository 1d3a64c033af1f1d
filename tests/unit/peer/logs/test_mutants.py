"""If this fails, the storms would not see a shell that is wrong: then their silence is worth nothing."""

from __future__ import annotations

import pytest

from unit.peer.logs.mutants import MUTANTS, Mutant
from unit.peer.logs.storm import found_after


@pytest.mark.parametrize("mutant", MUTANTS, ids=lambda mutant: mutant.__name__)
def test_every_mutant_is_found(mutant: Mutant, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as patch:
        mutant(patch)
        assert found_after(MUTANTS[mutant]) is not None
