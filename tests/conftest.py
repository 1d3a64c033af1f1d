"""What holds for every test: order, Hypothesis profiles, and that nothing unexpected is logged.

Unexpected warnings of Python fail a test through `filterwarnings = error` in pyproject.toml; unexpected log lines of
level WARNING and above fail it here. A test that provokes one says so, and then it must come:

    @pytest.mark.expect_log("a truncated frame")
"""

from __future__ import annotations

import logging
import re
from collections.abc import Generator
from pathlib import Path
from typing import Any

import hypothesis
import pytest
import structlog

from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.world.sim.run import settle

use_kernel_cache()

# Fast ones first, so that a slip shows within seconds. Those that take minutes come together: some compute, and others wait.
ORDER = (("house",), ("unit",), ("study",), ("conformance",), ("render",), ("simulation", "integration", "models"))
# Of these the longest first, lest one of them runs alone at the end: a process of tests takes whole files, in this order.
LONGEST = (
    "integration/test_log_partition.py",
    "models/test_models.py",
    "simulation/test_every_step.py",
    "integration/test_moving_processes.py",
    "simulation/test_mutants.py",
    "integration/test_log_kill_points.py",
    "integration/test_observers_processes.py",
    "integration/test_scenectl_membership.py",
    "integration/test_render_still_ends.py",
    "integration/test_enrolling.py",
    "simulation/test_smoke.py",
    "integration/test_purging_processes.py",
    "integration/test_render_still.py",
    "integration/test_cluster_processes.py",
    "simulation/test_rotation.py",
    "integration/test_rotating_processes.py",
    "integration/test_bad_input.py",
    "integration/test_copies_processes.py",
    "integration/test_versions_processes.py",
    "integration/test_voters_processes.py",
    "integration/test_first_node_away.py",
    "integration/test_render_resume.py",
    "integration/test_who_renders.py",
    "simulation/test_client_boxes.py",
    "integration/test_reading_processes.py",
    "integration/test_scenectl_cluster.py",
    "integration/test_nothing_in_the_clear.py",
    "simulation/test_replay.py",
)
LEVELS = {"debug": 10, "info": 20, "warn": 30, "warning": 30, "error": 40, "exception": 40, "critical": 50, "fatal": 50}

# Machines that run tests are slow at times; a deadline would only measure that.
hypothesis.settings.register_profile("default", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True, max_examples=40)
hypothesis.settings.register_profile("thorough", deadline=None, max_examples=2000)
hypothesis.settings.load_profile("default")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Sort by the folder below tests/, and there by file for those that take long, keeping the order otherwise."""
    here = Path(__file__).parent
    if gone := [name for name in LONGEST if not (here / name).is_file()]:
        raise pytest.UsageError(f"{Path(__file__)}: of the longest files some are gone: {', '.join(gone)}")
    folders = {folder: place for place, together in enumerate(ORDER) for folder in together}
    files = {here / name: place for place, name in enumerate(LONGEST)}

    def rank(item: pytest.Item) -> tuple[int, int]:
        folder = item.path.relative_to(here).parts[0] if item.path.is_relative_to(here) else ""
        return folders.get(folder, len(ORDER)), files.get(item.path, len(LONGEST))

    items.sort(key=rank)


def pytest_collection_finish() -> None:
    """Each simulated run begins with a collection; of all that was imported that takes a quarter of a second, so it looks at the rest alone."""
    settle()


class Complaints(logging.Handler):
    """Keeps what was logged at WARNING and above."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        self.lines.append(f"{record.levelname} {record.name}: {record.getMessage()}")


def _through_logging(_logger: Any, method: str, event: structlog.typing.EventDict) -> structlog.typing.EventDict:
    """Hand a structlog event to the standard logging, where pytest shows it and Complaints sees it."""
    details = " ".join(f"{key}={value}" for key, value in event.items() if key not in ("event", "exc_info"))
    exc_info = event.get("exc_info")
    logging.getLogger("scenefold").log(LEVELS.get(method, 20), "%s %s", event.get("event"), details, exc_info=exc_info)
    raise structlog.DropEvent


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: pytest.Item) -> Generator[None, None, None]:
    """Fail a test that logged what it did not expect, or did not log what it expected."""
    structlog.configure(processors=[_through_logging], cache_logger_on_first_use=False)
    complaints = Complaints()
    ours = logging.getLogger("scenefold")
    level = ours.level
    logging.getLogger().addHandler(complaints)
    try:
        yield
    finally:
        logging.getLogger().removeHandler(complaints)
        # Simulations silence our logs for their whole process; the next test may expect a line.
        ours.setLevel(level)
    expected = [str(marker.args[0]) for marker in item.iter_markers("expect_log")]
    surprises = [line for line in complaints.lines if not any(re.search(pattern, line) for pattern in expected)]
    missing = [pattern for pattern in expected if not any(re.search(pattern, line) for line in complaints.lines)]
    if surprises:
        pytest.fail("unexpected log lines:\n" + "\n".join(surprises), pytrace=False)
    if missing:
        pytest.fail("log lines that did not come: " + ", ".join(missing), pytrace=False)
