"""Code with one safeguard taken out, for tests that show what it is there for."""

from __future__ import annotations

import inspect
import sys
import textwrap
from typing import Any

import pytest


def bend(monkeypatch: pytest.MonkeyPatch, owner: Any, name: str, old: str, new: str) -> None:
    """Replace a piece of the source of a function of a module or class; it must be there exactly once."""
    function = inspect.getattr_static(owner, name)
    source = textwrap.dedent(inspect.getsource(function))
    assert source.count(old) == 1, f"{name} has {source.count(old)} times: {old}"
    module = inspect.getmodule(function)
    assert module is not None
    names: dict[str, Any] = {}
    text = "from __future__ import annotations\n" + source.replace(old, new)
    exec(text, vars(module), names)
    monkeypatch.setattr(owner, name, names[name])
    if owner is module:
        _bend_importers(monkeypatch, function, names[name])


def _bend_importers(monkeypatch: pytest.MonkeyPatch, function: Any, bent: Any) -> None:
    """Modules that took the function by name have it, too."""
    for other in [module for name, module in sys.modules.items() if name.startswith("scenefold.peer.line")]:
        for name, value in list(vars(other).items()):
            if value is function:
                monkeypatch.setattr(other, name, bent)
