"""The node's place on the line: its arc, handovers to neighbours, adoption of gaps, strays (specs/12-line.md)."""
