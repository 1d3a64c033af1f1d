"""Keys of both suites that every test may use. Making an RSA key takes half a second, so those are the ones of the golden vectors."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scenefold.crypto import ED25519, RSA3072, SealingKey, SigningKey

VECTORS: dict[str, Any] = json.loads(
    (Path(__file__).resolve().parents[3] / "specs" / "vectors" / "records.json").read_text(encoding="utf-8")
)

_RSA_RECORD = next(entry for entry in VECTORS["records"] if entry["header"]["suite"] == RSA3072)
_RSA_SEALING = next(entry for entry in VECTORS["sealings"] if entry["suite"] == RSA3072)

SIGNING = {ED25519: SigningKey.from_seed(b"w" * 32), RSA3072: SigningKey(_RSA_RECORD["private_key"].encode(), RSA3072)}
SEALING = {ED25519: SealingKey(b"x" * 32), RSA3072: SealingKey(_RSA_SEALING["private_key"].encode(), RSA3072)}
