"""Payload codecs of a scene's records, one file each; what their bytes mean is in specs/05-scene-content.md."""

from scenefold.scene.payloads.cameras import Camera
from scenefold.scene.payloads.document import SceneDocument, decode_document
from scenefold.scene.payloads.geometry import GeometryAtom, decode_atom
from scenefold.scene.payloads.groups import GroupTable, decode_groups
from scenefold.scene.payloads.instances import InstanceTable, decode_instances
from scenefold.scene.payloads.light_table import LightTable, decode_lights
from scenefold.scene.payloads.materials import AlphaMode, Material, TextureUse, Wrap, decode_materials
from scenefold.scene.payloads.punctual import PunctualLight, decode_punctual
from scenefold.scene.payloads.textures import Texture, join_textures
from scenefold.scene.payloads.tiles import TextureTile, decode_tile

__all__ = [
    "AlphaMode",
    "Camera",
    "GeometryAtom",
    "GroupTable",
    "InstanceTable",
    "LightTable",
    "Material",
    "PunctualLight",
    "SceneDocument",
    "Texture",
    "TextureTile",
    "TextureUse",
    "Wrap",
    "decode_atom",
    "decode_document",
    "decode_groups",
    "decode_instances",
    "decode_lights",
    "decode_materials",
    "decode_punctual",
    "decode_tile",
    "join_textures",
]
