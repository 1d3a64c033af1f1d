"""Ground floor: ids, locations and arcs, limits, errors. Knows nobody."""
