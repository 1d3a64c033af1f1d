"""Versions and disks in the words of a judge, and which version is the newer one. Pure."""

from __future__ import annotations

from collections.abc import Iterable

from scenefold.simulation.history import Place, Version


def order_of(version: Version) -> tuple[int, int, int, int, bytes]:
    return version.order


def is_newer(version: Version | None, than: Version) -> bool:
    """This version, or a newer one."""
    return version is not None and version.order >= than.order


def name_of(place: Place, version: Version) -> str:
    return f"{version.digest.hex()[:6]} of {place.location.hex()[:8]}… in space {place.space}"


def names_of(slots: Iterable[int]) -> str:
    return ", ".join(f"n{slot}" for slot in sorted(slots)) or "no disk"
