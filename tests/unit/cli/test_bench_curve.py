"""If this fails, `bench curve` compares unlike things, or does not say what it could not compare with."""

from __future__ import annotations

import importlib
import json
from typing import Any

import pytest

from scenectl.bench_curve import CurveBench, bench_curve
from scenectl.program import main

TINY = ["bench", "curve", "--points", "64", "--boxes", "2", "--arcs", "4", "--rounds", "1"]


def test_without_the_rivals_our_figures_stand_alone(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    real = importlib.import_module

    def absent(name: str, package: str | None = None) -> Any:
        if name.startswith("hilbert"):
            raise ImportError(name)
        return real(name, package)

    monkeypatch.setattr(importlib, "import_module", absent)
    assert main([*TINY, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["missing"] == ["hilbertcurve", "numpy-hilbert-curve"]
    assert [(result["curve"], result["dimensions"], result["bits"]) for result in report["results"]] == [
        ("hilbert", 2, 80),
        ("z-order", 2, 80),
        ("hilbert", 3, 53),
        ("z-order", 3, 53),
        ("hilbert", 4, 40),
        ("z-order", 4, 40),
    ]
    assert all(result["encode_ratio"] is None and not result["rivals"] for result in report["results"])
    assert main(TINY) == 0
    assert "pip install 'scenefold[bench]'" in capsys.readouterr().out


def test_rivals_get_as_many_bits_as_they_can() -> None:
    pytest.importorskip("hilbert")
    pytest.importorskip("hilbertcurve")
    report = bench_curve(CurveBench(points=64, boxes=1, arcs=4, rounds=1))
    assert report["missing"] == []
    for result in report["results"]:
        bits = {rival["name"]: rival["bits"] for rival in result["rivals"]}
        dimensions = result["dimensions"]
        wanted = {"numpy-hilbert-curve": 64 // dimensions, "hilbertcurve": min(result["bits"], 64)}
        assert bits == (wanted if result["curve"] == "hilbert" else {})
        assert (result["decode_ratio"] is None) == (result["curve"] == "z-order")
