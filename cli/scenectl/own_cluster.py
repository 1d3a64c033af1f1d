"""Options of a cluster that a verb starts for itself: they mean nothing beside a profile, whose cluster runs already."""

from __future__ import annotations

import os
from collections.abc import Mapping

from scenefold.base.errors import UsageFault

PROFILE_VARIABLE = "SCENEFOLD_PROFILE"


def check_own_cluster(where: str, profile: str | None, given: Mapping[str, tuple[object, str]]) -> None:
    """UsageFault for the first option of a cluster of one's own that stands beside a profile, with how to have either.

    `given`: by option its value (None: not given) and its variable, if it has one. A variable may stay set: it says what a cluster shall
    have if one is started.
    """
    if profile is None:
        return
    for option, (value, variable) in given.items():
        if value is None or is_of_variable(value, variable):
            continue
        what = f"{option} is of a cluster that is started for this, and a profile names one that runs"
        raise UsageFault(
            what, where=where, remedy=f"leave out {option} to use the cluster of the profile, or {without_profile(profile)} to start one"
        )


def without_profile(profile: str) -> str:
    """What to do that it is not given."""
    return f"unset {PROFILE_VARIABLE}" if os.environ.get(PROFILE_VARIABLE) == profile else "leave out --profile"


def is_of_variable(value: object, variable: str) -> bool:
    """Whether an option has its value from the environment, and may be without meaning."""
    return bool(variable) and os.environ.get(variable) == str(value)
