"""If this fails, cryptography is done outside of crypto/ with what Python itself brings, which no door of a library keeps in.

A digest of bytes that everybody may see is no secret's matter: who needs one is named here, with what it is for. A key, a password or a
comparison of secrets belongs into crypto/. Dice are drawn where the machine is met.
"""

from __future__ import annotations

import ast

import pytest

from house.sources import imports_of, lies_in, module_of, python_files

CRYPTO = "scenefold.crypto"
DIGESTS = {
    "scenefold.base.kernel_cache": "names a folder by the sources that were compiled",
    "scenefold.client.blobs": "ids that follow from names, and whether all parts are those that were written",
    "scenefold.client.own_keys": "shows people the fingerprint of a public key",
    "scenefold.client.part_places": "scatters places that everybody may see",
    "scenefold.client.scene_memory": "keeps which header was met",
    "scenefold.client.tombstones": "the mark of a deleted record, a constant",
    "scenefold.peer.cluster_log.log_voter": "ids of entries that are proposed again",
    "scenefold.peer.copies.losses_note": "ids of what may have been lost",
    "scenefold.render.image_files": "names an image by its pixels",
    "scenefold.render.kept": "finds what was damaged in a file of one's own",
    "scenefold.render.numbers": "scatters a job's dice by seed and frame",
    "scenefold.render.passes": "names a path by job and number",
    "scenefold.render.pool.whole_scene": "tells whether a scene is the one that was rendered before",
    "scenefold.render.rehearsal.pool": "names an image by its bytes",
    "scenefold.render.renderers.embree.numeric_class": "draws fixed rays, and names what a processor makes of them",
    "scenefold.scene.archive": "finds what was changed in a file that everybody may read",
    "scenefold.scene.importers.plan": "tells whether an import is the one that began",
    "scenefold.scene.log.first": "the id of a scene's first entry",
    "scenefold.scene.payloads.document": "names what is stored by its content",
    "scenefold.scene.payloads.splits": "names parts by what they hold; two marks, which are constants",
    "scenefold.simulation": "draws a test's keys and dice from its seed",
    "scenefold.store.layout": "finds what has rotted",
    "scenefold.store.measuring": "makes records to measure with",
    "scenefold.store.wrecks": "finds what has not rotted",
    "scenefold.wire.log_records": "the chain of a log",
    "scenefold.wire.scene_headers": "the genesis of a scene",
    "scenefold.world.log_file": "finds what has rotted",
    "scenefold.world.nearby": "draws by chance: the key is the dice, kept from nobody",
    "scenefold.world.sim": "draws dice from a seed; the trace",
    "scenefold.world.toml_files": "finds what has rotted",
}
DICE = {
    "scenefold.world": "the machine's dice, and names of what is being written",
    "scenefold.client.own_keys": "hands the machine's dice to crypto, for a person's own keys",
}
KEYED = {"scenefold.world.nearby"}
SECRETIVE = {"blake2b", "blake2s", "scrypt", "pbkdf2_hmac", "compare_digest"}
"""What takes a key or a password, or is for comparing secrets."""

FILES = {module_of(path): path for path in python_files("src", "cli") if not lies_in(module_of(path), CRYPTO)}


@pytest.mark.parametrize(
    ("library", "allowed"), [("hashlib", DIGESTS), ("secrets", DICE), ("hmac", {})], ids=["hashlib", "secrets", "hmac"]
)
def test_what_python_brings_is_used_where_it_is_said_what_for(library: str, allowed: dict[str, str]) -> None:
    using = [module for module, path in FILES.items() if any(lies_in(name, library) for name in imports_of(path))]
    assert [module for module in using if not lies_in(module, *allowed)] == []
    assert [entry for entry in allowed if not any(lies_in(module, entry) for module in using)] == [], "nobody needs it any more"


def test_no_hash_outside_of_crypto_takes_a_key() -> None:
    using = {module for module, path in FILES.items() if SECRETIVE & _names_in(path.read_text(encoding="utf-8"))}
    assert using == KEYED


def _names_in(source: str) -> set[str]:
    """Every name that is imported, or taken from something, in a file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Attribute):
            found.add(node.attr)
        elif isinstance(node, ast.ImportFrom):
            found.update(alias.name for alias in node.names)
    return found


def test_names_are_seen_however_they_are_reached() -> None:
    assert _names_in("import hashlib\nhashlib.scrypt(b'')") & SECRETIVE == {"scrypt"}
    assert _names_in("from hmac import compare_digest as same") & SECRETIVE == {"compare_digest"}
