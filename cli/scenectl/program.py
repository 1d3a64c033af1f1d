"""The program `scenectl`: the groups of verbs, each in a file of its own that is imported when one of its verbs is called.

So `scenectl --help` imports cyclopts and nothing of ours but this, `errors` and `output`. Whatever a verb
raises ends here as one line on standard error and an exit code (errors.py).
"""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError, UnusedCliTokensError

from scenectl.errors import DONE, FAILED, READER_LEFT, STANDARD_OUTPUT, WRONG_USAGE, Ending, Interrupted, ending_of, reader_left
from scenectl.flags import is_given
from scenectl.output import drop, emit_error, plain_logs, writing_to
from scenefold.base.kernel_cache import use_kernel_cache

GROUPS = {
    "cluster": "Make a cluster, join it, and look at it.",
    "node": "Run nodes, let them leave, and look at what they have stored.",
    "scene": "Make scenes, fill them, and say who may use them.",
    "space": "Make, move and query the spaces of a scene.",
    "data": "Read and write single records of a scene.",
    "key": "Look at your keys, lock them, back them up, and take them along.",
    "render": "Render images.",
    "image": "Keep finished images in their scene, and fetch them.",
    "bench": "Measure, as the project's own documentation does.",
    "demo": "The whole way in one go: five nodes, the sample scene, an image.",
}


def build_app() -> App:
    """The command line as a cyclopts application; no group is imported yet."""
    app = App(
        name="scenectl",
        help=(
            "Scenes that are stored, edited and path-traced on a handful of ordinary computers.\n\n"
            "Example: scenectl render still kitchen.glb -o kitchen.exr"
        ),
        version=_version,
        # It ends as any error does, in a line; cyclopts would say nothing.
        suppress_keyboard_interrupt=False,
        help_format="plaintext",
        help_epilogue=(
            "Exit codes: 0 done, 1 failed, 2 wrong usage, 3 cluster unreachable, "
            "4 refused by consensus or mode, 5 degraded, 130 interrupted."
        ),
    )
    for name, about in GROUPS.items():
        app.command(f"scenectl.{name}:app", name=name, help=about)
    return app


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code."""
    _plug()
    _drop_empty_settings()
    use_kernel_cache()
    plain_logs()
    tokens = list(sys.argv[1:] if arguments is None else arguments)
    as_json, debug = is_given("--json", tokens), is_given("--debug", tokens)
    if sys.stdout is None:
        remedy = "send it to a file, or to /dev/null"
        ending = Ending("failed", FAILED, "there is nowhere to write", where="standard output is closed", remedy=remedy)
        return emit_error(ending, as_json=False)
    try:
        result = build_app()(tokens, exit_on_error=False, print_error=False, result_action="return_value")
        with writing_to(STANDARD_OUTPUT):
            sys.stdout.flush()
        return result if isinstance(result, int) else DONE
    except CycloptsError as error:
        return emit_error(_usage_ending(error), as_json=as_json, error=error if debug else None)
    except (Exception, KeyboardInterrupt, SystemExit, BaseExceptionGroup) as error:
        if reader_left(error):
            drop(sys.stdout)
            return READER_LEFT
        if isinstance(error, SystemExit):
            raise
        ending = ending_of(error)
        return emit_error(ending, as_json=as_json, error=error if debug and not isinstance(error, Interrupted) else None)


def _plug() -> None:
    """Keep the places of standard streams that were closed, lest a socket take one, and be written to as if it were the stream."""
    if None in (sys.stdin, sys.stdout, sys.stderr):
        while (place := os.open(os.devnull, os.O_RDWR)) < 3:
            continue
        os.close(place)
    if sys.stderr is None:
        sys.stderr = os.fdopen(2, "w", closefd=False)


def _drop_empty_settings() -> None:
    """A variable that is empty says as much as none: many who set up environments cannot take one away."""
    for name in [name for name, value in os.environ.items() if name.startswith("SCENEFOLD_") and not value]:
        del os.environ[name]


def _usage_ending(error: CycloptsError) -> Ending:
    chain = " ".join(error.command_chain or ())
    command = f"scenectl {chain}".strip()
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        many = len(error.unused_tokens) > 1
        what = f"{', '.join(map(repr, error.unused_tokens))} {'are arguments' if many else 'is an argument'} too many"
    else:
        # The list of commands is cut at some length; the help has all of them.
        what = " ".join(str(error).partition("Available commands:")[0].split()).rstrip(".")
    return Ending("usage", WRONG_USAGE, what, where=command, remedy=f"see `{command} --help`")


def _version() -> str:
    import scenefold

    return f"scenectl {scenefold.__version__}"
