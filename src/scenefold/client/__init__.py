"""The Python client: `connect`, `Cluster`, `Scene`, `Space`. Speaks only the wire; knows nothing of a node's inside.

Names load on first use, so that a command that only prints its help does not pay for Trio and cryptography.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from scenefold.client.ailments import Ailment
    from scenefold.client.cards import card_for, member_name
    from scenefold.client.cluster import Cluster
    from scenefold.client.cluster_health import ClusterHealth, Condition
    from scenefold.client.connecting import connect, create_cluster, profile_folder
    from scenefold.client.copies import CopiesPlan
    from scenefold.client.exporting import ExportReport
    from scenefold.client.former_keys import FormerKeys
    from scenefold.client.fresh import FreshItem, Stored, put_fresh
    from scenefold.client.grants import Access, role_named
    from scenefold.client.health import ClusterStatus, NodeState
    from scenefold.client.importing import ImportReport, PreparedImport, prepare_import, scene_name_of
    from scenefold.client.log_telling import LogStory
    from scenefold.client.moving import Movement, Rate, movements, rates
    from scenefold.client.own_warnings import Concern
    from scenefold.client.participants import Deciders
    from scenefold.client.positions import Found
    from scenefold.client.progress import ProgressCallback, ProgressState
    from scenefold.client.proof import Proof
    from scenefold.client.purge_walk import Purge
    from scenefold.client.reading import open_scene_with_keys
    from scenefold.client.rebasing import Carried, Rebased
    from scenefold.client.reencryption import Reencryption
    from scenefold.client.removals import RemovedNode
    from scenefold.client.reports import DrainReport, HandoverReport, NodeReport
    from scenefold.client.requests import Change, InDoubt, Request
    from scenefold.client.restoring import CheckedArchive, RestoreOptions, RestoreReport, check_archive
    from scenefold.client.scene import Scene, SceneInfo
    from scenefold.client.scene_log import Standing
    from scenefold.client.scenes import SceneListing, Scenes
    from scenefold.client.space import ABSENT, Space
    from scenefold.client.splitting import SplitReport
    from scenefold.client.suspects import SuspectReport
    from scenefold.client.tidying import Tidied
    from scenefold.client.upkeep import Upkeep
    from scenefold.client.watching import Watch
    from scenefold.scene.log import EpochKeys, SceneKeys
    from scenefold.world.keyring import KeptScene, Keyring

_HOMES = {
    "scenefold.client.cards": "card_for member_name",
    "scenefold.client.cluster": "Cluster",
    "scenefold.client.ailments": "Ailment",
    "scenefold.client.cluster_health": "ClusterHealth Condition",
    "scenefold.client.connecting": "connect create_cluster profile_folder",
    "scenefold.client.copies": "CopiesPlan",
    "scenefold.client.exporting": "ExportReport",
    "scenefold.client.former_keys": "FormerKeys",
    "scenefold.client.fresh": "FreshItem Stored put_fresh",
    "scenefold.client.grants": "Access role_named",
    "scenefold.client.health": "ClusterStatus NodeState",
    "scenefold.client.own_warnings": "Concern",
    "scenefold.client.importing": "ImportReport PreparedImport prepare_import scene_name_of",
    "scenefold.client.log_telling": "LogStory",
    "scenefold.client.moving": "Movement Rate movements rates",
    "scenefold.client.participants": "Deciders",
    "scenefold.client.positions": "Found",
    "scenefold.client.progress": "ProgressCallback ProgressState",
    "scenefold.client.proof": "Proof",
    "scenefold.client.purge_walk": "Purge",
    "scenefold.client.reading": "open_scene_with_keys",
    "scenefold.client.rebasing": "Carried Rebased",
    "scenefold.client.reencryption": "Reencryption",
    "scenefold.client.removals": "RemovedNode",
    "scenefold.client.reports": "DrainReport HandoverReport NodeReport",
    "scenefold.client.requests": "Change InDoubt Request",
    "scenefold.client.restoring": "CheckedArchive RestoreOptions RestoreReport check_archive",
    "scenefold.client.scene": "Scene SceneInfo",
    "scenefold.client.scene_log": "Standing",
    "scenefold.client.scenes": "SceneListing Scenes",
    "scenefold.client.space": "ABSENT Space",
    "scenefold.client.splitting": "SplitReport",
    "scenefold.client.suspects": "SuspectReport",
    "scenefold.client.tidying": "Tidied",
    "scenefold.client.upkeep": "Upkeep",
    "scenefold.client.watching": "Watch",
    "scenefold.scene.log": "EpochKeys SceneKeys",
    "scenefold.world.keyring": "KeptScene Keyring",
}
_HOME_OF = {name: home for home, names in _HOMES.items() for name in names.split()}


def __getattr__(name: str) -> Any:
    home = _HOME_OF.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = globals()[name] = getattr(importlib.import_module(home), name)
    return value


__all__ = [
    "ABSENT",
    "Access",
    "Ailment",
    "Carried",
    "Change",
    "CheckedArchive",
    "Cluster",
    "ClusterHealth",
    "ClusterStatus",
    "Concern",
    "Condition",
    "CopiesPlan",
    "Deciders",
    "DrainReport",
    "EpochKeys",
    "ExportReport",
    "FormerKeys",
    "Found",
    "FreshItem",
    "HandoverReport",
    "ImportReport",
    "InDoubt",
    "KeptScene",
    "Keyring",
    "LogStory",
    "Movement",
    "NodeReport",
    "NodeState",
    "PreparedImport",
    "ProgressCallback",
    "ProgressState",
    "Proof",
    "Purge",
    "Rate",
    "Rebased",
    "Reencryption",
    "RemovedNode",
    "Request",
    "RestoreOptions",
    "RestoreReport",
    "Scene",
    "SceneInfo",
    "SceneKeys",
    "SceneListing",
    "Scenes",
    "Space",
    "SplitReport",
    "Standing",
    "Stored",
    "SuspectReport",
    "Tidied",
    "Upkeep",
    "Watch",
    "card_for",
    "check_archive",
    "connect",
    "create_cluster",
    "member_name",
    "movements",
    "open_scene_with_keys",
    "prepare_import",
    "profile_folder",
    "put_fresh",
    "rates",
    "role_named",
    "scene_name_of",
]
