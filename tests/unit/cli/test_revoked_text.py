"""If this fails, `cluster revoke` does not say what it did, and what was done before."""

from __future__ import annotations

from scenectl.enrolling import revoked_text
from scenefold.client.membership import Revoked


def test_the_words_say_what_was_done_now() -> None:
    node = {what: revoked_text("node:10.0.0.2", what, is_node=True) for what in (Revoked(True, True), Revoked(False, True), Revoked(False))}
    assert node[Revoked(True, True)] == "The keys of node:10.0.0.2 count no longer. The node is taken off the line."
    assert node[Revoked(False, True)] == "The keys of node:10.0.0.2 counted no longer already. The node is taken off the line."
    assert node[Revoked(False)] == "The keys of node:10.0.0.2 counted no longer already. The node does not stand on the line."
    assert revoked_text("user:ada", Revoked(True), is_node=False) == "The keys of user:ada count no longer."
