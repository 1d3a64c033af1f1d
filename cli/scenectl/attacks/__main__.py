"""One attack in a process of its own: `python -m scenectl.attacks SETTINGS`, a JSON object.

It attacks until its standard input ends, and reports in a JSON object on a line of its own: when it begins, now and then, and in the end.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from pathlib import Path
from typing import Any

import trio

from scenectl.attacks import ATTACKS, Attacker

REPORT_S = 0.5


async def attack(settings: dict[str, Any]) -> None:
    from scenefold.base.ids import SceneId, SpaceId
    from scenefold.base.location import Location
    from scenefold.world.profile import ClusterProfile

    profile = ClusterProfile.load(Path(settings["profile"]))
    place = Location.fromhex(settings["place"])
    me = Attacker(
        profile=profile,
        address=settings["address"],
        scene=SceneId(settings["scene"]),
        scene_name=settings["scene_name"],
        space=SpaceId(settings["space"]),
        place=place,
        far=Location.fromhex(settings["far"]),
        lie=Path(settings["lie"]),
    )
    begun, spent = time.monotonic(), time.process_time()

    def report() -> None:
        seen = dict(sorted(me.seen.items()))
        print(json.dumps({"seconds": time.monotonic() - begun, "cpu_s": time.process_time() - spent, "seen": seen}), flush=True)

    async def report_now_and_then() -> None:
        while True:
            report()
            await trio.sleep(REPORT_S)

    async with trio.open_nursery() as nursery:
        nursery.start_soon(ATTACKS[settings["attack"]], me)
        nursery.start_soon(report_now_and_then)
        await trio.to_thread.run_sync(sys.stdin.read, abandon_on_cancel=True)
        nursery.cancel_scope.cancel()
    report()


def main() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard if hard < 1 << 16 else max(soft, 1 << 16), hard))
    trio.run(attack, json.loads(sys.argv[1]))


if __name__ == "__main__":
    main()
