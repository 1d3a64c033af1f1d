"""If this fails, reports say of a process what another one has used."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from scenefold.world import process_use as module
from scenefold.world.process_use import process_use

SHOWN = "from scenefold.world.process_use import process_use as use; print(*use())"


def test_what_was_used_counts_and_stays() -> None:
    before = process_use()
    table = np.ones(before.memory_most // 8 + (64 << 20) // 8)
    with_it = process_use()
    del table
    assert before.processor_s < with_it.processor_s
    assert with_it.memory_most >= before.memory_most + (32 << 20)
    assert process_use().memory_most >= with_it.memory_most - (8 << 20), "the kernel counts in lots"


def test_a_process_does_not_have_what_its_starter_had() -> None:
    table = np.ones((256 << 20) // 8)
    done = subprocess.run([sys.executable, "-c", SHOWN], check=True, capture_output=True, text=True)
    del table
    seconds, most = done.stdout.split()
    assert 0 < float(seconds) < 60 and 1 << 20 < int(most) < 200 << 20


def test_where_the_system_has_no_such_file_it_is_asked_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_STATUS", module._STATUS / "nothing")
    assert process_use().memory_most > 1 << 20
