"""A scene's log: which spaces a scene has and what their addresses mean, as a pure fold of its records (specs/16-scene-log.md).

Light to import: numpy and the curves come with the first position that is asked for.
"""

from scenefold.scene.log.affine import Affine
from scenefold.scene.log.book import SceneLog
from scenefold.scene.log.bytes import OpenedLog, open_private, seal_private, sign_record
from scenefold.scene.log.first import first_entry, first_log, first_record
from scenefold.scene.log.space import CellBox, LoggedSpace, SpaceFault

__all__ = [
    "Affine",
    "CellBox",
    "LoggedSpace",
    "OpenedLog",
    "SceneLog",
    "SpaceFault",
    "first_entry",
    "first_log",
    "first_record",
    "open_private",
    "seal_private",
    "sign_record",
]
