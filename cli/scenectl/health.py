"""`scenectl cluster health`: whether all records have their copies, and what to do if not."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE, Interrupted
from scenectl.names import SceneOption
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note
from scenectl.rates import bytes_per_s

if TYPE_CHECKING:
    from scenectl.progress import Progress
    from scenefold.client import ClusterHealth, Proof


def health(
    *,
    prove: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    scene: SceneOption | None = None,
    rate: float | None = None,
    acknowledge: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Show whether all records have their copies, what is wrong and what to do about it, and how long mending takes. Exit code 5 if the cluster is degraded.

    Nodes say what they know. With --prove nobody is believed: all copies are read, and verified here; that may be interrupted at any time.

    Example: scenectl cluster health --profile studio

    Example: scenectl cluster health --prove --scene kitchen --rate 50 --profile studio

    Parameters
    ----------
    prove
        Read every copy of every record, and count those that are valid, on how many nodes, in how many failure domains (nodes that keep copies away from each other by their blacklists are of one). No scene's key is needed; where the profile has it, records are opened as well.
    scene
        Prove the records of this scene only: its name, or its id.
    rate
        MiB that --prove reads in a second, at most; by default as fast as it goes.
    acknowledge
        You have seen what may be lost with nodes that were removed: it is said no longer. For administrators.
    """
    from scenectl.health_text import health_text, proof_text, seen_text
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenefold.base.errors import UsageFault
    from scenefold.client import Condition, Proof
    from scenefold.client.copy_reports import LossReport

    so_far, seen = Proof(), list[LossReport]()

    speed = bytes_per_s(rate)
    if not prove and (scene is not None or rate is not None):
        raise UsageFault("nothing is read without --prove", where="--scene, --rate", remedy="give --prove as well, or leave them out")

    async def look(progress: Progress) -> tuple[ClusterHealth, Proof | None]:
        async with connected(output.profile) as cluster:
            found = await cluster.health()
            if acknowledge:
                seen.extend(found.losses)
                await cluster.acknowledge_losses(found)
                found = await cluster.health() if seen else found
            return found, await cluster.prove(found, scene, progress, speed, so_far) if prove else None

    try:
        with Progress(quiet=output.json) as progress:
            found, proof = run(look, progress)
    except Interrupted:
        if so_far.records and not output.json:
            note(proof_text(so_far))
        raise
    is_degraded = found.condition is Condition.DEGRADED or (proof is not None and not proof.is_sound)
    document = found.document() | {"proof": None if proof is None else proof.document(), "acknowledged": [loss.id for loss in seen]}
    if is_degraded:
        document["status"] = str(Condition.DEGRADED)
    emit(
        output, document, health_text(found, proof) + seen_text(seen) + ("" if proof is None else f"\n\n{proof_text(proof, found.losses)}")
    )
    return DEGRADED if is_degraded else DONE
