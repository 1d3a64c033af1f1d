"""If this fails, a storage node that was killed takes edits of before again, behind an answer that somebody renders by (design scenario 33)."""

from __future__ import annotations

import trio

from scenefold.peer.timing import T_WAIT_S
from scenefold.wire import SceneMode, SetMode
from simulation.assembly import Assembly, assembled

STORES = 3
"""The node that takes no part, and has no key."""


def test_33_the_write_floor_that_was_told_survives_the_node_that_told_it() -> None:
    """It is killed at the moment at which a reader would have its answer, and comes back alone, where nobody can tell it anything."""

    async def main(them: Assembly) -> None:
        await them.create(0, 1, 2)
        await trio.sleep(T_WAIT_S)
        address = them.node(STORES).address
        others = [them.node(slot).address for slot in range(STORES)]
        for mode in (SceneMode.RENDER, SceneMode.EDIT):
            position = await them.commits(1, SetMode(mode))
            told = await them.of(STORES).scenes.known(them.scene, position=position)
            them.crash(STORES)
            assert (told.public.mode, told.public.write_floor) == (mode, position)
            parted = them.cluster.net.partition([address], others)
            await them.node(STORES).gone.wait()
            them.cluster.start(STORES)
            await them.until(lambda: them.node(STORES).context is not None)
            kept = them.of(STORES).scenes.here(them.scene)
            assert kept is not None
            assert (kept.public.mode, kept.public.position, kept.public.write_floor) == (mode, position, position)
            them.cluster.net.unite(parted)
            await them.until(them.of(STORES).joined.is_set, 120.0)

    assembled(STORES + 1, main)
