"""If this fails, Scenefold is held against other figures of etcd than were measured, or a machine without etcd is told nothing."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import pytest

FOLDER = Path(__file__).parents[3] / "benchmarks"


@pytest.fixture
def beside_etcd(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The script, as a module: it stands beside what it imports, and is no package."""
    monkeypatch.syspath_prepend(str(FOLDER))
    return importlib.import_module("beside_etcd")


def _turn(rate: float, killed: list[float]) -> dict[str, Any]:
    figures = {"commits_per_s": rate, "p50_ms": 1000 / rate, "p99_ms": 2000 / rate, "cpu_ms_per_commit": None}
    ours = {way: figures | {"commits_per_s": rate / 10} for way in ("one_client", "one_scene", "a_scene_each")}
    return {"etcd": {"one_client": figures, "clients": figures, "killed": killed}, "scenefold": {**ours, "killed": [killed[0] / 2]}}


def test_medians_of_the_turns_are_compared_and_every_death_is_told(beside_etcd: Any) -> None:
    turns = [_turn(100.0, [2.0]), _turn(500.0, [1.0]), _turn(200.0, [3.0])]
    found = beside_etcd.compared(turns)
    assert (found["one_client"]["etcd"]["commits_per_s"], found["one_client"]["scenefold"]["commits_per_s"]) == (200.0, 20.0)
    assert found["a_scene_each"]["etcd"]["p99_ms"] == 10.0 and found["one_scene"]["scenefold"]["cpu_ms_per_commit"] is None
    assert found["killed"] == {"etcd": [1.0, 2.0, 3.0], "scenefold": [0.5, 1.0, 1.5]}
    told = beside_etcd.text({"compared": found, "clients": 16, "etcd_version": "3.4.23", "members": 5, "tls": False})
    assert "16 clients, a scene each" in told and "etcd: 1.00, 2.00, 3.00 s" in told and told.endswith("without TLS")


def test_without_etcd_it_says_how_to_have_it(beside_etcd: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(sys, "argv", ["beside_etcd.py", "--etcd", "/nowhere/etcd"])
    assert beside_etcd.main() == 77
    assert "apt-get download etcd-server" in capsys.readouterr().err
