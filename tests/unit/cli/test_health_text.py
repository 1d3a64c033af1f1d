"""If this fails, `cluster health` hides from people what is wrong, or what to do about it."""

from __future__ import annotations

from scenectl.health_text import health_text
from unit.client.test_cluster_health import FILLING, LACKING, copies, health, nodes
from unit.client.test_health import ADDRESSES, arc, missing


def test_a_healthy_cluster_is_said_to_be_and_nothing_else() -> None:
    text = health_text(health(*nodes()))
    assert (
        text.splitlines()[0] == "studio: healthy: 360 records, 300 of them in spaces with copies, all where they belong, as the nodes say"
    )
    assert len(text.splitlines()) == 2 + 1 + len(ADDRESSES)


def test_what_is_wrong_is_followed_by_what_to_do() -> None:
    text = health_text(health(*nodes(copies(**LACKING, **FILLING))))
    assert text.splitlines()[0].endswith("; healthy in about 3 s")
    assert "40 of 100 records lie on fewer nodes than they should, up to 1 copy fewer\n  -> wait" in text


def test_a_silent_node_has_its_line_and_the_time_is_not_known() -> None:
    first, second, _ = nodes(copies(**LACKING))
    text = health_text(health(first, second, missing(ADDRESSES[2], arc(0.5, 1))))
    assert "degraded" in text.splitlines()[0] and text.splitlines()[0].endswith("how long it takes is not known")
    assert any(line.startswith(ADDRESSES[2]) and "silent" in line for line in text.splitlines())
    assert f"{ADDRESSES[2]} does not answer" in text and "-> start it" in text
