"""If this fails, the story of a failing seed leaves out what matters, or drowns it."""

from __future__ import annotations

from scenefold.simulation.faults import Fault, Kind
from scenefold.simulation.story import TOLD_MAX, Story, Violation, told

PLACE, OTHER = b"p" * 20, b"o" * 20


def test_a_story_is_of_the_place_and_the_nodes_concerned() -> None:
    story = Story()
    story.tell(1.0, 0, "starts")
    story.tell(2.0, 1, "is cut off")
    story.tell(3.0, 0, "writes {}", 1, location=PLACE)
    story.tell(4.0, 0, "writes {}", 2, location=OTHER)
    story.tell(5.0, None, "everything heals")
    lines = story.about(Violation("law", "what", 6.0, location=PLACE, slots=(0,)))
    assert [line.split("s  ", 1)[1].split(maxsplit=1)[1] for line in lines[:2]] == ["starts", "writes 1"]
    assert len(lines) == 3


def test_long_stories_keep_their_end() -> None:
    story = Story()
    for second in range(TOLD_MAX + 5):
        story.tell(float(second), 0, "ticks")
    lines = story.about(Violation("law", "what", 999.0))
    assert lines[0] == "… 5 earlier lines"
    assert f"{TOLD_MAX + 4}.000" in lines[-1]


def test_the_whole_says_how_to_see_it_again() -> None:
    schedule = (Fault(Kind.PARTITION, 1.0, 2.0, (1, 2)), Fault(Kind.LOSS, 3.0, 4.0, (), 0.1))
    text = told(
        7, schedule, [3, 9], [Violation("linearizable", "a write is gone", 9.0)], ["a line"], "python -m scenefold.simulation --replay 7"
    )
    for part in (
        "seed 7: 1 violation\n",
        "linearizable: a write is gone",
        " 3    1.00 s",
        "n1, n2 from all others",
        "a line",
        "--replay 7",
    ):
        assert part in text
