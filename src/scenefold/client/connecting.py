"""From a profile to a connected cluster."""

from __future__ import annotations

from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from pathlib import Path

from scenefold.base.errors import LocalFault, UsageFault
from scenefold.client.cluster import Cluster
from scenefold.client.known_log import Known
from scenefold.client.renewal import renew_if_due
from scenefold.crypto import DEFAULT_SUITE, MemberSecrets, SecretFolder, refuse_to_ask
from scenefold.crypto.secret_folder import AskPassphrase
from scenefold.world import Ports, World, background_tasks, offline_world, open_links, real_world
from scenefold.world.log_file import LogFile
from scenefold.world.own_papers import check_papers
from scenefold.world.profile import ClusterProfile

DEFAULT_PROFILE = "default"


@asynccontextmanager
async def connect(profile: str | Path | None = None, ask: AskPassphrase = refuse_to_ask) -> AsyncIterator[Cluster]:
    """A cluster, by the folder or the name of its profile (see `profile_folder`).

    `ask`: called in a worker thread, if a passphrase locks the user's keys, with the place where they lie; returns the passphrase.

    Nothing is sent before the first call; that one finds the nodes by those that the profile lists, and takes the
    table of who is there from the first that answers. Only if the user's certificate is due to be renewed, that comes first.
    LocalFault if there is no such profile, OutOfDate if the certificate does not count by this computer's clock, Refused (17) if this
    profile has seen that its user's key was revoked.
    """
    known, world, secrets, log = await offline_world().workers.run("import", _read, profile, ask)
    async with open_links(world) as links, background_tasks() as nursery:
        cluster = Cluster(known, world, links, secrets, log)
        cluster.log.check_own()
        nursery.start_soon(cluster.log.run)
        nursery.start_soon(cluster.calls.leases.run)
        await renew_if_due(cluster.membership)
        try:
            yield cluster
        finally:
            await cluster.calls.leases.close()
        await cluster.log.settled()


def _read(profile: str | Path | None, ask: AskPassphrase) -> tuple[ClusterProfile, World, MemberSecrets, Known]:
    """What of a profile lies on disk, and the world that its user's identity opens."""
    known = ClusterProfile.load(profile_folder(profile))
    opened = SecretFolder(known.user_folder(), ask)
    identity = known.user_identity(secrets=opened)
    secrets = known.user_secrets(secrets=opened)
    check_papers(known, identity, secrets)
    world = real_world(identity, known.authority_certificate(), ports=known.ports)
    return known, world, secrets, LogFile(known.folder).load()


def profile_folder(profile: str | Path | None) -> Path:
    """The folder of a profile: the one named if it exists, else that of this name among the user's profiles."""
    import platformdirs

    _check_named(profile)
    wanted = Path(DEFAULT_PROFILE if profile is None else profile)
    named = Path(platformdirs.user_config_path("scenefold", appauthor=False)) / wanted
    if profile is not None and (wanted.is_dir() or wanted.is_absolute()):
        return wanted
    if named.is_dir():
        return named
    where = str(named) if profile is None else f"{wanted} and {named}"
    remedy = "make one with `scenectl cluster init`, or join a cluster with `scenectl cluster join`, and name it with --profile or SCENEFOLD_PROFILE"
    raise LocalFault("there is no cluster profile", where=where, remedy=remedy)


def profile_place(profile: str | Path | None) -> Path:
    """The folder of a profile that need not be there yet: as `profile_folder`, else the path that was given, or the default name."""
    import platformdirs

    _check_named(profile)
    try:
        return profile_folder(profile)
    except LocalFault:
        default = Path(platformdirs.user_config_path("scenefold", appauthor=False)) / DEFAULT_PROFILE
        return default if profile is None else Path(profile)


def _check_named(profile: str | Path | None) -> None:
    # As a path it would be the current folder, which is hardly ever meant.
    if profile == "":
        raise UsageFault("the name of the profile is empty", where="--profile", remedy="name a folder, or leave it out for the default one")


def create_cluster(
    folder: Path,
    name: str,
    node_addresses: Sequence[str],
    *,
    spares: Sequence[str] = (),
    ports: Ports | None = None,
    suite: int = DEFAULT_SUITE,
    trust_all: bool = False,
) -> ClusterProfile:
    """Make authority and keys of a new cluster in a folder, whole or not at all. `spares` may join it later. `suite`: of the user's keys.

    `trust_all`: the cluster trusts all these nodes from the start, so that they render; else the first one only.
    """
    return ClusterProfile.create(folder, name, node_addresses, spares=spares, ports=ports, suite=suite, trust_all=trust_all)
