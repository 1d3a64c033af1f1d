"""Two moments that a judge of modes looks at, in the product's own code: an edit is found to be signed in time, and a node is fenced.

Nothing is changed; who looks on is told when the code goes past them.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

from scenefold.base.ids import SceneId, SpaceId
from scenefold.client.calls import Calls
from scenefold.client.leases import Edit
from scenefold.client.sealing import SceneIdentity
from scenefold.peer import NodeContext


def see_signed(calls: Calls, seen: Callable[[int], None]) -> None:
    """Call `seen` whenever this client finds that it may send what it has signed, with the position of the lease by which it may.

    Not where it takes the scene for one of which nobody needs leases.
    """
    leases: Any = calls.leases
    edit: Callable[[], Edit] = leases.edit

    def watched() -> Edit:
        made: Any = edit()
        may_send: Callable[[SceneIdentity, Collection[SpaceId]], bool] = made.may_send

        def may_it(identity: SceneIdentity, needs: Collection[SpaceId]) -> bool:
            found = may_send(identity, needs)
            if found and made._borrowing is not None:
                held = made._borrowing.loan.held
                seen(identity.position if held is None else held.position)
            return found

        made.may_send = may_it
        return made  # type: ignore[no-any-return]

    leases.edit = watched


def see_fenced(context: NodeContext, seen: Callable[[SceneId, int], None]) -> None:
    """Call `seen` with a scene's write floor whenever this life of a node has found that nothing of below it comes in any more."""
    reads: Any = context.data.reads
    fenced = reads._fenced

    async def watched(scene: SceneId, position: int) -> tuple[int, int]:
        said: tuple[int, int] = await fenced(scene, position)
        seen(scene, said[1])
        return said

    reads._fenced = watched
