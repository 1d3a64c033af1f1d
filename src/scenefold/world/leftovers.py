"""What killed writers left of a profile: drafts of it and of its members' folders, with keys in the clear (specs/04-records.md, Drafts)."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from scenefold.base.errors import LocalFault
from scenefold.crypto import make_private_folder
from scenefold.crypto.drafts import new_folder, sweep_folders

_MEMBERS = ("users", "nodes")


def sweep_profile(profile: Path) -> None:
    """Remove all of it, but what another process is writing at this moment. The profile itself need not be there."""
    sweep_folders(profile.parent, profile.name)
    for room in _MEMBERS:
        sweep_folders(profile / room)


@contextmanager
def draft_of(profile: Path, step: str = "") -> Iterator[Path]:
    """A folder beside the profile to put it together in; afterwards it is gone, or has become the profile. LocalFault if it cannot be made.

    `step`: what else than a new profile it is for; one of those that `sweep_profile` knows.
    """
    make_private_folder(profile.parent)
    sweep_profile(profile)
    with ExitStack() as whole:
        try:
            draft = whole.enter_context(new_folder(profile.with_name(profile.name + step)))
        except OSError as problem:
            what = f"cannot make a folder there: {problem.strerror or problem}"
            remedy = "check its permissions" if isinstance(problem, PermissionError) else "choose another folder"
            raise LocalFault(what, where=str(profile.parent), remedy=remedy) from problem
        yield draft
