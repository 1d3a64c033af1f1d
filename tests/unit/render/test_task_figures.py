"""If this fails, a render by tasks reports what they have not done, or puts an image together of parts that do not belong together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from scenefold.base.errors import LocalFault
from scenefold.render.tasks.figures import Figures
from scenefold.render.tasks.work import Seen, Use

BOX = (np.zeros(3), np.ones(3))
SEEN = Seen("embree", b"content", BOX, 0.0, ())


def use(node: str, thread: int, begun: float, ended: float, casts: int) -> Use:
    return Use(
        node=node, thread=thread, processor_from_s=begun, processor_to_s=ended, memory_most=1000 + casts, busy_s=0.5, bytes_read=7, paths=10,
        rays=3, casts=casts,
    )  # fmt: skip


def test_processes_and_threads_are_told_apart() -> None:
    figures = Figures()
    figures.add(SEEN, use("a:1", 1, 2.0, 3.0, 30), 100)
    figures.add(SEEN, use("a:1", 2, 2.5, 4.0, 10), 100)
    figures.add(SEEN, use("b:9", 1, 7.0, 8.0, 20), 50)
    document = figures.document(30, {"render": 2.0}, 3)
    first, second = document["render_nodes"]
    assert (first["address"], first["threads"], first["tasks"], first["casts"], first["bytes_read"]) == ("a:1", 2, 2, 40, 14)
    assert (first["processor_seconds"], second["processor_seconds"]) == (2.0, 1.0), "of a process, however many of its threads worked"
    assert first["memory_most"] == 1030
    assert (document["paths"], document["paths_per_second"], document["bytes_returned"]) == (30, 15.0, 250)
    assert document["efficiency"] == 60 / (3 * 30)


def test_threads_without_work_are_threads() -> None:
    figures = Figures()
    figures.add(SEEN, use("a:1", 1, 2.0, 3.0, 30), 100)
    assert figures.document(30, {}, 4)["efficiency"] == 0.25
    figures.add(SEEN, use("a:1", 2, 2.0, 3.0, 30), 100)
    assert figures.document(30, {}, 1)["efficiency"] == 1.0, "one came later"


def test_workers_of_two_numeric_classes_make_no_image() -> None:
    figures = Figures()
    figures.add(SEEN, use("a:1", 1, 0.0, 1.0, 1), 1)
    with pytest.raises(LocalFault, match=r"two numeric classes.*b:1.*same versions"):
        figures.add(replace(SEEN, numeric_class="other"), use("b:1", 1, 0.0, 1.0, 1), 1)


def test_nor_do_those_that_read_different_files() -> None:
    figures, other = Figures(), replace(SEEN, content=b"edited")
    figures.add(SEEN, use("a:1", 1, 0.0, 1.0, 1), 1)
    with pytest.raises(LocalFault, match=r"different scenes.*b:1"):
        figures.add(other, use("b:1", 1, 0.0, 1.0, 1), 1)
    figures.add(other, use("b:1", 1, 0.0, 1.0, 1), 1, is_same_scene=False)
