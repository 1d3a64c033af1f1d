"""`scenectl scene add-observer`, `remove-observer`: which nodes render a scene under a lease of their own, and decide nothing."""

from __future__ import annotations

from typing import TYPE_CHECKING

from scenectl.deciding import emit_deciders
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput
from scenectl.repeating import RequestOption, one_change
from scenectl.values import AddressOption
from scenefold.base.ids import node_id_of
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client import Deciders


def add_observer(
    scene: SceneName, address: AddressOption, /, *, request: RequestOption = None, output: ProfileOutput = DEFAULT_PROFILE
) -> None:
    """Let a trusted node render the scene under a lease of its own: its renders are not cut by a change of the mode. Only owners of the scene can.

    It is asked at each change of the mode, and never counted in a majority. A scene that is decided where scenes begin has no leases, so no observers.

    Example: scenectl scene add-observer kitchen 192.168.1.20 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    address
        IPv4 address of the node.
    """
    from scenectl.running import connected, run

    change = Change(request)

    async def do() -> Deciders:
        async with connected(output.profile) as cluster:
            (entry,) = await cluster.membership.participants([node_id_of(address.text)])
            return await (await cluster.scenes.open(scene)).add_observer(entry, again=change)

    with one_change("scene add-observer", scene, change):
        found = run(do)
    emit_deciders(output, scene, found, change)


def remove_observer(
    scene: SceneName, address: AddressOption, /, *, request: RequestOption = None, output: ProfileOutput = DEFAULT_PROFILE
) -> None:
    """Let a node observe the scene no more, such as one that is gone for good: each change of the mode would wait for it. Only owners can.

    Example: scenectl scene remove-observer kitchen 192.168.1.20 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    address
        IPv4 address of the node.
    """
    from scenectl.running import connected, run

    change = Change(request)

    async def do() -> Deciders:
        async with connected(output.profile) as cluster:
            return await (await cluster.scenes.open(scene)).remove_observer(node_id_of(address.text), again=change)

    with one_change("scene remove-observer", scene, change):
        found = run(do)
    emit_deciders(output, scene, found, change)
