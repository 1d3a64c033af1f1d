"""What a scene holds: its spaces, the codecs of its records, importers, and the tables a renderer reads.

Thesis 3.1 and B.4; bytes and rules in specs/05-scene-content.md. Importers are imported late by those who
import a file: they load curve kernels and image libraries.
"""

from scenefold.scene.layout import DOCUMENT_LOCATION, SPACE_NAMES, SPACES, SpaceLayout, item_location
from scenefold.scene.payloads.document import SceneDocument, decode_document
from scenefold.scene.tables import SceneTables, instance_groups

__all__ = [
    "DOCUMENT_LOCATION",
    "SPACES",
    "SPACE_NAMES",
    "SceneDocument",
    "SceneTables",
    "SpaceLayout",
    "decode_document",
    "instance_groups",
    "item_location",
]
