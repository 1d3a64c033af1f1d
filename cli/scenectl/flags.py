"""Flags that count from before the arguments are read to when that fails. It imports nothing: see `__main__`."""

from __future__ import annotations

from collections.abc import Sequence

_NO = frozenset({"no", "n", "0", "false", "f"})


def is_given(flag: str, tokens: Sequence[str]) -> bool:
    """Whether a flag is among the options: alone or with a value, `--json=true`; behind `--` everything is an argument."""
    options = tokens[: tokens.index("--")] if "--" in tokens else tokens
    values = [value for name, _, value in (token.partition("=") for token in options) if name == flag]
    return any(value.lower() not in _NO for value in values)
