"""One node's folder looked at, and mended, while no node runs on it: `scenectl node verify` and `node repair` (specs/21-verify.md)."""

from scenefold.peer.checking.folder import Checked, Repaired, check_folder, mend_folder

__all__ = ["Checked", "Repaired", "check_folder", "mend_folder"]
