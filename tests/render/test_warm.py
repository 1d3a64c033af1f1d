"""If this fails, `make install` no longer compiles what a render needs, and five nodes do it at the same time, in its midst."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = """
import sys
from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.render.warm import warm

def compiled():
    from numba.core.registry import CPUDispatcher
    ours = [module for name, module in list(sys.modules.items()) if name.startswith("scenefold.")]
    found = {value for module in ours for value in vars(module).values() if isinstance(value, CPUDispatcher)}
    return {f"{value.py_func.__module__}.{value.py_func.__name__}{signature}" for value in found for signature in value.signatures}

sys.path.insert(0, "tests")
warm()
before = compiled()
from render.rig import Rig
from render.shapes import room
rig = Rig(room(), 40)
for nodes, algorithm in ((2, "voronoi"), (3, "bounded-radial")):
    rig.render(algorithm, nodes, sky=(0.1, 0.1, 0.1))
print("\\n".join(sorted(compiled() - before)))
"""


@pytest.mark.timeout(300)
def test_nothing_is_left_to_compile() -> None:
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", SCRIPT], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split("\n") == ["", ""], done.stdout
