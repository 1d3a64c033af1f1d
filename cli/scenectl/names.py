"""Names as options and arguments: what cannot be one is wrong usage, told before anything is read or asked."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Annotated, Any

from cyclopts import Parameter, Token

from scenefold.base.names import NAME_CHARACTERS_MAX, SPACE_NAME_RULE, USER_NAME_CHARACTERS_MAX, is_name, is_space_name, name_rule

SHOWN_CHARACTERS_MAX = 80


def checked(text: str, what: str, is_good: Callable[[str], bool], rule: str) -> str:
    """The name; ValueError saying what is allowed."""
    if not is_good(text):
        raise ValueError(f"{text[:SHOWN_CHARACTERS_MAX]!r} cannot be the name of a {what}: use {rule}")
    return text


def checked_user(text: str) -> str:
    """A user's name; ValueError for what cannot be one."""
    return _checked("user", USER_NAME_CHARACTERS_MAX, text)


def checked_space(text: str) -> str:
    """The name of a space; ValueError for what cannot be one."""
    return checked(text, "space", is_space_name, SPACE_NAME_RULE)


def _checked(what: str, characters_max: int, text: str) -> str:
    return checked(text, what, lambda name: is_name(name, characters_max), name_rule(characters_max))


def _named(check: Callable[[str], str]) -> Parameter:
    def convert(_kind: Any, tokens: Sequence[Token]) -> str:
        return check(tokens[0].value)

    return Parameter(converter=convert)


SceneName = Annotated[str, _named(partial(_checked, "scene", NAME_CHARACTERS_MAX))]
ClusterName = Annotated[str, _named(partial(_checked, "cluster", NAME_CHARACTERS_MAX))]
UserName = Annotated[str, _named(checked_user)]
NewSpaceName = Annotated[str, _named(checked_space)]
SceneOption = Annotated[SceneName, Parameter(name=("--scene", "-s"))]
