"""Fields that keep their packet's or struct's law, made from fields that were drawn one by one."""

from __future__ import annotations

from typing import Any

from scenefold.wire.laws import All, Law, Needs, OneOf, Order, Pairs
from scenefold.wire.log_entries import Boxed


def lawful(law: Law | None, fields: dict[str, Any]) -> dict[str, Any]:
    """The same fields, as little changed as the law asks for; what it cannot mend is left to a filter."""
    match law:
        case All():
            for part in law.laws:
                fields = lawful(part, fields)
        case Order():
            lower, upper = fields[law.lower], fields[law.upper]
            if lower is not None and upper is not None and lower > upper:
                fields = {**fields, law.lower: upper, law.upper: lower}
        case Needs():
            if fields[law.needed] is None:
                fields = {**fields, law.field: None}
        case OneOf():
            fields = {**fields, law.second: fields[law.second] and not fields[law.first]}
        case Pairs():
            extras, count = fields[law.extras], len(fields[law.items])
            if len(extras) < count:
                fields = {**fields, law.extras: ()}
            else:
                fields = {**fields, law.extras: extras[:count]}
        case Boxed():
            sides = [sorted(pair) for pair in zip(fields["low"], fields["high"], strict=False)]
            low, high = tuple(pair[0] for pair in sides), tuple(pair[1] for pair in sides)
            fields = {**fields, "dimensions": len(sides), "low": low, "high": high}
        case None:
            pass
        case _:
            raise AssertionError(law)
    return fields
