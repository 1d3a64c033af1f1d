"""One attack in a process of its own: `python -m scenectl.attacks SETTINGS`, a JSON object.

It says `begun` in a line, attacks until its standard input ends, and reports in a JSON object.
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


async def attack(settings: dict[str, Any]) -> dict[str, Any]:
    from scenefold.base.ids import SceneId, SpaceId
    from scenefold.base.location import Location
    from scenefold.world.profile import ClusterProfile

    profile = ClusterProfile.load(Path(settings["profile"]))
    place = Location.fromhex(settings["place"])
    me = Attacker(profile, settings["address"], SceneId(settings["scene"]), SpaceId(settings["space"]), place)
    begun, spent = time.monotonic(), time.process_time()
    async with trio.open_nursery() as nursery:
        nursery.start_soon(ATTACKS[settings["attack"]], me)
        print("begun", flush=True)
        await trio.to_thread.run_sync(sys.stdin.read, abandon_on_cancel=True)
        nursery.cancel_scope.cancel()
    return {"seconds": time.monotonic() - begun, "cpu_s": time.process_time() - spent, "seen": dict(sorted(me.seen.items()))}


def main() -> None:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard if hard < 1 << 16 else max(soft, 1 << 16), hard))
    print(json.dumps(trio.run(attack, json.loads(sys.argv[1]))))


if __name__ == "__main__":
    main()
