"""What `bench curve` does: our curves beside the two Hilbert curves that people take from PyPI, in one run.

A rival gets as many bits an axis as it can: `numpy-hilbert-curve` has 64 bits for a whole index, `hilbertcurve` any
number, so it is measured with as many as ours. Ours always works on all 160 bits of a location. Seconds are those of
one thread's processor time; all works of a curve take turns, because a machine's speed drifts.
"""

from __future__ import annotations

import importlib
import time
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from scenectl.output import table

if TYPE_CHECKING:
    from scenefold.base.measuring import Rate, Work
    from scenefold.curve import Curve

DIMENSIONS = (2, 3, 4)
NUMPY_BITS_MAX = 64
"""Bits of a whole index of `numpy-hilbert-curve`."""
INSTALL = "pip install 'scenefold[bench]'"

# Rivals are a hundred times slower: as many points as take about as long.
_NUMPY_SHARE = 64
_PYTHON_SHARE = 512


@dataclass(frozen=True, kw_only=True)
class CurveBench:
    """What to measure."""

    points: int
    boxes: int
    arcs: int
    rounds: int


def bench_curve(bench: CurveBench) -> dict[str, Any]:
    """Measure and return the report (docs/reference/scenectl.md)."""
    from scenefold.base.measuring import measure_in_turns
    from scenefold.curve import Curve, curve_works

    missing: list[str] = []
    results: list[dict[str, Any]] = []
    for dimensions in DIMENSIONS:
        for kind in ("hilbert", "z-order"):
            curve = Curve(kind, dimensions)
            works = curve_works(curve, bench.points, bench.boxes, bench.arcs)
            rivals = _rivals(curve, bench.points, missing) if kind == "hilbert" else {}
            everything = [*works, *(work for _, pair in rivals.values() for work in pair)]
            results.append(_result(curve, measure_in_turns(everything, time.thread_time, bench.rounds), rivals))
    return {"points": bench.points, "boxes": bench.boxes, "arcs_max": bench.arcs, "missing": sorted(set(missing)), "results": results}


def bench_text(report: dict[str, Any]) -> str:
    """The report for people."""
    rows: list[tuple[str, ...]] = []
    for result in report["results"]:
        arcs = f"{result['boxes_per_second']['median']:,.0f}"
        ratios = [f"{ratio:.0f}x" for ratio in (result["encode_ratio"], result["decode_ratio"]) if ratio is not None]
        rows.append((*_rates(f"{result['curve']}, ours", result), arcs, " / ".join(ratios) or "-"))
        rows += [(*_rates(rival["name"], {**rival, "dimensions": result["dimensions"]}), "-", "-") for rival in result["rivals"]]
    lines = [table(("curve", "D", "bits an axis", "encode/s", "decode/s", "boxes/s", "ours / the faster rival"), rows)]
    if report["missing"]:
        lines.append(f"not installed, so not compared: {', '.join(report['missing'])}; {INSTALL}")
    return "\n".join(lines)


def _rates(name: str, result: dict[str, Any]) -> tuple[str, ...]:
    rates = (f"{result[key]['median']:,.0f}" for key in ("encode_points_per_second", "decode_points_per_second"))
    return (name, str(result["dimensions"]), str(result["bits"]), *rates)


def _result(curve: Curve, rates: dict[str, Rate], rivals: dict[str, tuple[int, list[Work]]]) -> dict[str, Any]:
    beside = [
        {
            "name": name,
            "bits": bits,
            "encode_points_per_second": asdict(rates[f"{name} encode"]),
            "decode_points_per_second": asdict(rates[f"{name} decode"]),
        }
        for name, (bits, _) in rivals.items()
    ]
    return {
        "curve": curve.kind,
        "dimensions": curve.dimensions,
        "bits": curve.bits,
        "encode_points_per_second": asdict(rates["encode"]),
        "decode_points_per_second": asdict(rates["decode"]),
        "boxes_per_second": asdict(rates["arcs"]),
        "rivals": beside,
        "encode_ratio": _ratio(rates["encode"], [rates[f"{name} encode"] for name in rivals]),
        "decode_ratio": _ratio(rates["decode"], [rates[f"{name} decode"] for name in rivals]),
    }


def _ratio(ours: Rate, theirs: list[Rate]) -> float | None:
    """How much faster than the fastest of them; None if there is none."""
    return ours.median / max(rate.median for rate in theirs) if theirs else None


def _rivals(curve: Curve, points: int, missing: list[str]) -> dict[str, tuple[int, list[Work]]]:
    """Bits an axis and works of each rival that is installed, by its name on PyPI."""
    found = {}
    for name, works in (("numpy-hilbert-curve", _numpy_works), ("hilbertcurve", _python_works)):
        try:
            found[name] = works(curve, points)
        except ImportError:
            missing.append(name)
    return found


def _numpy_works(curve: Curve, points: int) -> tuple[int, list[Work]]:
    import numpy as np

    from scenefold.base.measuring import Work
    from scenefold.curve import random_cells

    rival = importlib.import_module("hilbert")
    bits = NUMPY_BITS_MAX // curve.dimensions
    count = max(points // _NUMPY_SHARE, 64)
    cells = random_cells(curve, count) >> np.uint64(curve.cell_bits - bits)
    indexes = rival.encode(cells, curve.dimensions, bits)
    return bits, [
        Work("numpy-hilbert-curve encode", count, lambda: rival.encode(cells, curve.dimensions, bits)),
        Work("numpy-hilbert-curve decode", count, lambda: rival.decode(indexes, curve.dimensions, bits)),
    ]


def _python_works(curve: Curve, points: int) -> tuple[int, list[Work]]:
    from scenefold.base.measuring import Work
    from scenefold.curve import random_cells

    rival = importlib.import_module("hilbertcurve.hilbertcurve").HilbertCurve(curve.cell_bits, curve.dimensions)
    count = max(points // _PYTHON_SHARE, 64)
    cells = random_cells(curve, count).tolist()
    indexes = rival.distances_from_points(cells)
    return curve.cell_bits, [
        Work("hilbertcurve encode", count, lambda: rival.distances_from_points(cells)),
        Work("hilbertcurve decode", count, lambda: rival.points_from_distances(indexes)),
    ]
