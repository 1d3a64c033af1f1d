"""A whole cluster in one process, in virtual time, from a seed (specs/17-simulation.md).

    weather   what goes wrong and when, drawn from the seed          (pure)
    cluster   nodes of the simulated world, the same code as real ones
    workload  clients that write, read and ask for ranges, with the real client code
    checkers  what must hold, whatever the weather was                (pure)
    story     what happened, for a person; shrink: with as few faults as possible

`python -m scenefold.simulation` runs seeds; `python -m scenefold.simulation.scale` measures large clusters.
"""
