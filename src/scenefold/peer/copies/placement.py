"""Placement, where services of copies look for it: clients place as well, so it stands on the lowest floor."""

from scenefold.base.placement import Holders, Layout, Line, holders_at, segments

__all__ = ["Holders", "Layout", "Line", "holders_at", "segments"]
