"""`scenectl cluster health`: whether all records have their copies, and what to do if not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.errors import DEGRADED, DONE
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit

if TYPE_CHECKING:
    from scenefold.client import ClusterHealth


def health(*, output: ProfileOutput = DEFAULT_PROFILE) -> int:
    """Show whether all records have their copies, what is wrong and what to do about it, and how long mending takes. Exit code 5 if the cluster is degraded.

    Example: scenectl cluster health --profile studio
    """
    from scenectl.health_text import health_text
    from scenectl.running import connected, run
    from scenefold.client import Condition

    async def look() -> ClusterHealth:
        async with connected(output.profile) as cluster:
            return await cluster.health()

    found = run(look)
    emit(output, found.document(), health_text(found))
    return DEGRADED if found.condition is Condition.DEGRADED else DONE
