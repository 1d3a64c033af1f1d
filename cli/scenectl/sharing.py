"""`scenectl scene grant`, `access`, `revoke`, `rotate-key`: who may use a scene, and under which key it lies."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from scenectl.errors import DEGRADED, DONE, Interrupted, most_telling
from scenectl.member_values import GranteeOption, shown_member
from scenectl.names import SceneName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, note, size_text, table
from scenectl.rates import bytes_per_s
from scenectl.repeating import RequestOption, decided_text, one_change, position_of
from scenefold.base.errors import ScenefoldError, UsageFault
from scenefold.client.requests import Change

if TYPE_CHECKING:
    from scenefold.client import Access, FormerKeys, Reencryption

LOOK_S_MAX = 86_400.0

DryRun = Annotated[bool, Parameter(negative="", show_default=False)]


def grant(
    scene: SceneName,
    who: GranteeOption,
    /,
    *,
    role: Annotated[str, Parameter(name=("--role", "-r"))] = "reader",
    card: Path | None = None,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Let somebody use a scene: a user, or a node that shall read it for itself. Only owners of the scene can.

    Again with a higher role raises it. To take some of it away, revoke it and grant less.

    Example: scenectl scene grant kitchen user:ada --role writer --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    who
        user:NAME, node:ID or the address of a node.
    role
        reader (reads), writer (writes, too) or owner (grants and revokes, too).
    card
        Certificate of the member; by default the one that the cluster knows.
    """
    from scenectl.running import connected, run
    from scenefold.client import card_for, role_named

    wanted, change = role_named(role), Change(request)

    async def do() -> Access:
        async with connected(output.profile) as cluster:
            member = await card_for(cluster, who.text, card)
            return await (await cluster.scenes.open(scene)).grant(member, wanted, again=change)

    with one_change("scene grant", scene, change):
        access = run(do)
    text = f"{shown_member(who.text)} may use {scene} as {role}.\n{_members(access)}{decided_text(change)}"
    emit(output, {"scene": scene, **access.document(), **position_of(change)}, text)


def access(scene: SceneName, /, *, look: float | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show who may use a scene, in which role, and whether records still lie under keys that others may have.

    Example: scenectl scene access kitchen --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    look
        Seconds to look for records under former keys, at most; by default 3.
    """
    from scenectl.running import connected, run

    look_s = seconds_to_look(look)

    async def ask() -> tuple[Access, FormerKeys]:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            return await opened.members(), await opened.former_keys(look_s)

    found, former = run(ask)
    document = {"scene": scene, **found.document(), "former_keys": former.value}
    emit(output, document, f"{_members(found)}\nkey epoch {found.key_epoch}{former_keys_text(scene, former)}")


def seconds_to_look(look: float | None) -> float:
    """UsageFault for what is no time to look."""
    from scenefold.client.former_keys import LOOK_S

    if look is not None and not 0 < look <= LOOK_S_MAX:
        raise UsageFault("that is no time to look", where="--look", remedy=f"give up to {LOOK_S_MAX:.0f} seconds")
    return LOOK_S if look is None else look


def former_keys_text(scene: str, former: FormerKeys) -> str:
    """What there is to do; nothing if all lies under the newest key."""
    match former.value:
        case "none":
            return ""
        case "some":
            return f"\nRecords lie under former keys, which those may have who were revoked. {_how_to_go_on(scene)}"
        case _:
            return f"\nNot all records were looked at: some may lie under former keys. {_how_to_go_on(scene)}"


def revoke(
    scene: SceneName,
    who: GranteeOption,
    /,
    *,
    later: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    rate: float | None = None,
    dry_run: DryRun = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """End somebody's access to a scene, and seal everything in it anew while others read and write. Only owners of the scene can; the last owner stays.

    From the first moment on everything that is written is sealed under a new key. What lies there already was open to the member, and is then sealed anew, too; that may be interrupted at any time, and `scene rotate-key --resume` goes on. Exit code 5 if something is left under an older key.

    Example: scenectl scene revoke kitchen user:ada --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    who
        user:NAME, node:ID or the address of a node.
    later
        Leave what lies there under the key that the member may have kept, until somebody calls `scene rotate-key --resume`.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    dry_run
        Look at all records, say who would be left and what would be sealed anew, and change nothing.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run
    from scenefold.client import member_name

    has = "would have" if dry_run else "has"
    name, speed, gone = member_name(who.text), bytes_per_s(rate), f"{shown_member(who.text)} {has} no access to {scene} any more"
    revoked: list[Access] = []
    change = Change(request)

    async def do(progress: Progress) -> Reencryption | None:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            revoked.append(await opened.revoke(name, dry_run=dry_run, again=change))
            if later:
                return None
            if dry_run:
                return await opened.look_what_is_to_seal(progress, speed, new_key=True)
            note(f"{gone}. What lies there is being sealed anew; this may be interrupted: {_resuming(scene)} goes on.")
            return await opened.reencrypt(progress, speed)

    try:
        with one_change("scene revoke", scene, change, is_none=dry_run, tells_rest=True), Progress(quiet=output.json) as progress:
            report = run(do, progress)
    except BaseException as error:
        if change.position is not None:
            done = f"{gone}, decided at position {change.position} of its log, but not all of its records are sealed anew"
            _say_what_is_left(error, done, scene)
        raise
    (left,) = revoked
    document = {"scene": scene, "dry_run": dry_run, **left.document(), **position_of(change)}
    document["sealed_anew"] = None if report is None else report.document()
    told = _left_as_it_is(scene, is_dry=dry_run) if report is None else _sealed(scene, report)
    # Who was told before the sealing began need not be told again.
    said = "" if report is not None and not dry_run else f"{gone}.\n"
    emit(output, document, f"{said}{_members(left)}\n{told}{decided_text(change)}")
    return DONE if report is None or report.is_complete else DEGRADED


def rotate_key(
    scene: SceneName,
    /,
    *,
    resume: Annotated[bool, Parameter(show_default=False)] = False,
    rate: float | None = None,
    dry_run: DryRun = False,
    request: RequestOption = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> int:
    """Change a scene's key, and seal everything in it anew while others read and write.

    May be interrupted at any time; what is done stays done, and --resume goes on. Exit code 5 if something is left under an older key.

    Example: scenectl scene rotate-key kitchen --rate 20 --profile studio

    Parameters
    ----------
    scene
        Name of the scene.
    resume
        Make no new key: seal anew what still lies under older ones. Writers can do this, too.
    rate
        MiB of records that are looked at in a second, at most; by default as fast as it goes.
    dry_run
        Look at all records, say what would be sealed anew, and change nothing.
    """
    from scenectl.progress import Progress
    from scenectl.running import connected, run

    speed, change = bytes_per_s(rate), Change(request)

    async def do(progress: Progress) -> Reencryption:
        async with connected(output.profile) as cluster:
            opened = await cluster.scenes.open(scene)
            if dry_run:
                return await opened.look_what_is_to_seal(progress, speed, new_key=not resume)
            if not resume:
                await opened.rotate_key(again=change)
            return await opened.reencrypt(progress, speed)

    try:
        is_none = resume or dry_run
        with one_change("scene rotate-key", scene, change, is_none=is_none, tells_rest=True), Progress(quiet=output.json) as progress:
            report = run(do, progress)
    except BaseException as error:
        if change.position is not None:
            done = f"{scene} has a new key, decided at position {change.position} of its log, but not all of its records are sealed anew"
            _say_what_is_left(error, done, scene)
        raise
    emit(output, {"scene": scene, **report.document(), **position_of(change)}, _sealed(scene, report) + decided_text(change))
    return DONE if report.is_complete else DEGRADED


def _say_what_is_left(error: BaseException, done: str, scene: str) -> None:
    """The same command again would find its first half done, so the error says how to go on."""
    problem = most_telling(error)
    if isinstance(problem, Interrupted):
        problem.what, problem.where, problem.remedy = f"interrupted; {done}", f"scene {scene}", _how_to_go_on(scene)
    elif isinstance(problem, ScenefoldError):
        problem.what, problem.remedy = f"{done}: {problem.what}", f"{problem.remedy}; {_resuming(scene)} goes on".removeprefix("; ")


def _resuming(scene: str) -> str:
    return f"`scenectl scene rotate-key {scene} --resume`"


def _how_to_go_on(scene: str, why: str = "") -> str:
    return f"{why} {_resuming(scene)} seals them anew, which any writer may do.".lstrip()


def _left_as_it_is(scene: str, *, is_dry: bool) -> str:
    if is_dry:
        return "Its records would stay under a key that the member may have. Nothing is changed."
    return _how_to_go_on(scene, "Its records stay under a key that the member may have kept.")


def _sealed(scene: str, report: Reencryption) -> str:
    if report.is_dry:
        what = f"{report.to_renew} of {report.walked} records, {size_text(report.bytes)} as they lie there"
        return f"{scene}: {what}, would be sealed anew, under key epoch {report.key_epoch}. Nothing is changed. {report.seconds:.1f} s."
    text = f"{scene} is under key epoch {report.key_epoch}: {report.renewed} records, {size_text(report.bytes)} sealed anew, {report.seconds:.1f} s."
    if report.unreadable:
        text += f"\n{report.unreadable} records stay as they are, among them:" + "".join(f"\n  {line}" for line in report.complaints)
    if not report.ended:
        text += f"\nRecords under older keys were still found in the last walk: {_resuming(scene)} goes on."
    return text


def _members(access: Access) -> str:
    rows = [(shown_member(row["name"]), row["role"], str(row["since"])) for row in access.document()["members"]]
    return table(("member", "role", "since"), rows)
