"""A user's certificate is renewed on the way, when somebody connects while it is due (specs/15-cluster-log.md, Enrolling)."""

from __future__ import annotations

import logging

import trio

from scenefold.base.errors import ScenefoldError
from scenefold.client.membership import Membership

PATIENCE_S = 3.0
"""Nobody waits longer for it: there are months left, and the next connection tries again."""

_log = logging.getLogger("scenefold.client")


async def renew_if_due(membership: Membership) -> None:
    """Renew the certificate if it is time. What goes wrong is said in the log only."""
    with trio.move_on_after(PATIENCE_S):
        try:
            card = await membership.renew()
        except ScenefoldError as problem:
            _log.info("the certificate is not renewed yet: %s", problem)
            return
        if card is not None:
            _log.info("the certificate of %s is renewed, until %s", card.name, f"{card.not_after:%Y-%m-%d}")
