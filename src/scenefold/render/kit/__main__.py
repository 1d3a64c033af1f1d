"""`python -m scenefold.render.kit NAME [--level bit]`: run the kit on an installed renderer."""

from __future__ import annotations

import argparse
import sys

from scenefold.base.errors import LocalFault
from scenefold.base.kernel_cache import use_kernel_cache
from scenefold.render.contract import load_renderer
from scenefold.render.kit import Level, checks


def main() -> int:
    """1 if a check failed."""
    parser = argparse.ArgumentParser(prog="python -m scenefold.render.kit", description="Test a renderer.")
    parser.add_argument("renderer", help="its entry point's name")
    parser.add_argument("--level", choices=[level.value for level in Level], default=Level.STATISTICAL.value)
    options = parser.parse_args()
    use_kernel_cache()
    failed = 0
    try:
        renderer = load_renderer(options.renderer)
        for name, check in checks(Level(options.level)).items():
            try:
                check(renderer)
                sys.stdout.write(f"passed  {name}\n")
            except AssertionError as problem:
                failed += 1
                sys.stdout.write(f"FAILED  {name}: {problem}\n")
    except LocalFault as fault:
        sys.stderr.write(f"{fault}\n")
        return 1
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
