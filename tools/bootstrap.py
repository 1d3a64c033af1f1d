"""Makes .venv ready for the Makefile: finds a Python, makes the environment, installs the pinned packages, remembers it.

`make` runs this before every target and reads standard output: the one word `ready`, or one line that says what is
wrong and what to do. What happens meanwhile is told on standard error. A stamp in .venv makes the second run instant;
it no longer counts when pyproject.toml or constraints.txt changed, when the clone was moved (installed scripts hold
absolute paths), or when the Python below it is gone.

This file must run on any Python from 3.6 on, because it is the one that has to say that a Python is too old. So: no
newer syntax, no imports beyond the standard library.
"""

import argparse
import contextlib
import fcntl
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
from typing import Dict, Iterator, List, Optional, Tuple

ROOT = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
OLDEST = (3, 11)
CANDIDATES = ("python3", "python3.11", "python3.12", "python3.13", "python3.14")
GET_PYTHON = "install Python %d.%d or newer, or name one with: make PYTHON=/path/to/python3" % OLDEST
# What an editable install needs, and what builds those requirements that the registry has no wheel of (setuptools:
# numpy-hilbert-curve); the one that venv brings is too old for it, and from Python 3.12 on it brings none.
BUILD_TOOLS = ["hatchling", "editables", "setuptools"]
PROBE = (
    "import sys, json, importlib.util as u; "
    "print(json.dumps([list(sys.version_info[:3]), all(u.find_spec(name) for name in ('venv', 'ensurepip'))]))"
)

# What pip says when it cannot get there, from urllib3 and the resolver of names below it.
NO_NETWORK = re.compile(
    "NewConnectionError|Max retries exceeded|Connection ?refused|Connection ?reset|Name or service not known|name resolution|"
    "Network is unreachable|ConnectTimeoutError|ReadTimeoutError|ProxyError|SSLError|CERTIFICATE_VERIFY_FAILED|RemoteDisconnected|"
    "Retrying \\(Retry|Could not fetch URL|Connection broken",
    re.IGNORECASE,
)


class Problem(Exception):
    """Something that the user must change; its text is the one line that they see."""


class Interpreter:
    """A Python that was asked for its version and for what a virtual environment needs."""

    def __init__(self, command: str, version: Tuple[int, ...], can_make_venv: bool) -> None:
        self.command = command
        self.version = version
        self.can_make_venv = can_make_venv

    @property
    def is_new_enough(self) -> bool:
        return self.version[:2] >= OLDEST

    @property
    def version_text(self) -> str:
        return ".".join(map(str, self.version))


def say(text: str) -> None:
    """Tell the user what is being done; standard output belongs to the Makefile."""
    sys.stderr.write("scenefold: %s\n" % text)
    sys.stderr.flush()


# ------------------------------------------------------------------------------------------------- which Python


def probe(command: str) -> Optional[Interpreter]:
    """What this command is, or None if it cannot be run (version managers leave stubs on PATH that only complain)."""
    path = shutil.which(command)
    if path is None:
        return None
    try:
        done = subprocess.run([path, "-c", PROBE], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, timeout=60, env=clean_environment())
        version, can_make_venv = json.loads(done.stdout.decode("utf-8"))
    except (OSError, ValueError, subprocess.TimeoutExpired):
        return None
    return Interpreter(path, tuple(version), bool(can_make_venv))


def choose_python(wanted: str) -> Interpreter:
    """The Python to use: the wanted one and no other, or else the first of CANDIDATES that serves."""
    found = [python for python in map(probe, [wanted] if wanted else CANDIDATES) if python is not None]
    if not found:
        raise Problem("cannot run %s: %s" % (wanted or "python3", GET_PYTHON))
    new_enough = [python for python in found if python.is_new_enough]
    if not new_enough:
        raise Problem(
            "scenefold needs Python %d.%d or newer, but %s is %s: %s" % (*OLDEST, found[0].command, found[0].version_text, GET_PYTHON)
        )
    for python in new_enough:
        if python.can_make_venv:
            return python
    raise Problem(no_venv_module(new_enough[0]))


def no_venv_module(python: Interpreter) -> str:
    return (
        "%s lacks the modules venv and ensurepip: install them (Debian, Ubuntu: apt install python%d.%d-venv), or name another Python with make PYTHON=..."
        % (
            python.command,
            python.version[0],
            python.version[1],
        )
    )


# ------------------------------------------------------------------------------------------------- what is there


def read_stamp(root: str) -> Dict[str, object]:
    """What the last complete run noted, {} if there was none."""
    try:
        with open(os.path.join(root, ".venv", "scenefold-stamp.json"), encoding="utf-8") as file:
            stamp = json.load(file)
    except (OSError, ValueError):
        return {}
    return stamp if isinstance(stamp, dict) else {}


def inputs_digest(root: str) -> str:
    """Changes whenever the installed packages might have to."""
    digest = hashlib.sha256()
    for name in ("pyproject.toml", "constraints.txt"):
        with open(os.path.join(root, name), "rb") as file:
            digest.update(file.read() + b"\0")
    return digest.hexdigest()


def stamp_for(root: str, extras: List[str]) -> Dict[str, object]:
    return {"root": root, "inputs": inputs_digest(root), "extras": sorted(extras)}


def noted_extras(stamp: Dict[str, object]) -> List[str]:
    extras = stamp.get("extras")
    return [str(extra) for extra in extras] if isinstance(extras, list) else []


def is_ready(root: str, wanted: str, extras: List[str]) -> bool:
    """Whether .venv already holds these extras, for this clone at this place, on the wanted Python, which still exists."""
    stamp = read_stamp(root)
    noted = noted_extras(stamp)
    if not set(extras) <= set(noted) or stamp != stamp_for(root, noted) or not os.path.exists(venv_python(root)):
        return False
    return not wanted or is_version_of(root, choose_python(wanted))


def is_version_of(root: str, wanted: Interpreter) -> bool:
    """Whether .venv runs on this version of Python."""
    inside = probe(venv_python(root))
    return inside is not None and inside.version == wanted.version


def venv_python(root: str) -> str:
    return os.path.join(root, ".venv", "bin", "python")


def why_unusable(root: str) -> str:
    """Why the existing .venv cannot be brought up to date and must be made anew; empty if it can."""
    inside = probe(venv_python(root))
    if inside is None:
        return "its Python no longer runs"
    if not inside.is_new_enough:
        return "its Python is %s" % inside.version_text
    try:
        with open(os.path.join(root, ".venv", "bin", "pip"), "rb") as file:
            opening = file.read(512)
    except OSError:
        return "it has no pip"
    return "" if os.path.join(root, ".venv", "bin").encode() in opening else "the folder was moved"


# ------------------------------------------------------------------------------------------------- making it


def clean_environment() -> Dict[str, str]:
    """The user's environment without what would lead pip or the new Python astray; their proxy and index stay."""
    environment = dict(os.environ)
    for name in ("PYTHONHOME", "PYTHONPATH", "__PYVENV_LAUNCHER__", "PIP_TARGET", "PIP_PREFIX", "PIP_USER"):
        environment.pop(name, None)
    environment.setdefault("PIP_RETRIES", "2")  # the default of five keeps people waiting when there is no network
    environment["PIP_DISABLE_PIP_VERSION_CHECK"] = "1"
    return environment


def make_venv(root: str, python: Interpreter) -> None:
    say("making .venv with %s (Python %s)" % (python.command, python.version_text))
    folder = os.path.join(root, ".venv")
    try:
        done = subprocess.run(
            [python.command, "-m", "venv", folder], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, env=clean_environment()
        )
    except KeyboardInterrupt:
        shutil.rmtree(folder, ignore_errors=True)  # a half-made one would puzzle the next run
        raise
    if done.returncode:
        shutil.rmtree(folder, ignore_errors=True)
        output = done.stdout.decode("utf-8", "replace")
        if "ensurepip" in output:
            raise Problem(no_venv_module(python))
        raise Problem("cannot make .venv with %s: %s" % (python.command, last_line(output)))


def remove_venv(root: str, why: str) -> None:
    """Make room for a new .venv; never touches a folder that is no virtual environment."""
    folder = os.path.join(root, ".venv")
    if os.path.islink(folder):
        os.unlink(folder)
        return
    if not os.path.exists(os.path.join(folder, "pyvenv.cfg")):
        raise Problem("%s exists but is no virtual environment: move it away" % folder)
    say("making .venv anew: %s" % why)
    shutil.rmtree(folder)


def pip_install(root: str, arguments: List[str]) -> None:
    """Run pip quietly; its words go to .venv/bootstrap.log, and to the user as one line if it fails."""
    command = [venv_python(root), "-m", "pip", "install", "--quiet", "--no-input", "-c", "constraints.txt"]
    log = os.path.join(root, ".venv", "bootstrap.log")
    with open(log, "ab") as file:
        start = file.tell()
        returncode = subprocess.call(command + arguments, cwd=root, stdout=file, stderr=subprocess.STDOUT, env=clean_environment())
    if returncode:
        with open(log, "rb") as file:
            file.seek(start)
            raise Problem(explain_pip(file.read().decode("utf-8", "replace"), log))


def explain_pip(output: str, log: str) -> str:
    """One line for what pip said in many."""
    missing = re.search(r"No matching distribution found for (\S+)|Cannot install (\S+?)[ ,]", output)
    if "No space left on device" in output:
        return "no space left on the device for .venv: free some (about 1 GB), then run the same command"
    # Before what it says of versions: without an answer from the registry pip calls every pinned one a conflict.
    if NO_NETWORK.search(output):
        return (
            "cannot reach the package registry%s: check the network or proxy, or set PIP_INDEX_URL to a mirror, then run the same command"
            % registry_named()
        )
    if missing:
        return (
            "the package registry has no %s that suits constraints.txt, this Python and this machine: try another with make PYTHON=..., see %s"
            % (missing.group(1) or missing.group(2), log)
        )
    return "pip failed: %s (all of it in %s)" % (last_line(output), log)


def registry_named() -> str:
    """Where pip was told to look, if the environment says so; never a password in it."""
    address = os.environ.get("PIP_INDEX_URL", "")
    return " at %s" % re.sub(r"//[^/@]*@", "//", address) if address else ""


def last_line(output: str) -> str:
    """The last line that names an error, or else the last one that is not empty."""
    lines = [line.strip() for line in output.splitlines() if line.strip()]
    errors = [line for line in lines if "error" in line.lower()]
    return (errors or lines or ["no output"])[-1]


@contextlib.contextmanager
def only_one_at_a_time() -> Iterator[None]:
    """Two makes in one folder take turns; the lock is this very file, so that nothing is left behind."""
    with open(os.path.abspath(__file__), "rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def bring_up(root: str, wanted: str, extras: List[str], kernels: bool) -> None:
    """Leave .venv complete and stamped, or raise Problem."""
    folder = os.path.join(root, ".venv")
    if os.path.lexists(folder):
        why = why_unusable(root)
        if not why and wanted:
            python = choose_python(wanted)
            why = "" if is_version_of(root, python) else "Python %s is wanted" % python.version_text
        if why:
            python = choose_python(wanted)
            remove_venv(root, why)
            make_venv(root, python)
    else:
        make_venv(root, choose_python(wanted))
    stamp_path = os.path.join(folder, "scenefold-stamp.json")
    extras = sorted(set(extras) | set(noted_extras(read_stamp(root))))
    stamp = stamp_for(root, extras)
    if os.path.exists(stamp_path):
        os.unlink(stamp_path)
    say("installing scenefold and its pinned packages into .venv, a minute or two (log: .venv/bootstrap.log)")
    # Built with the pinned tools, not with whatever an isolated build would fetch today.
    pip_install(root, BUILD_TOOLS)
    pip_install(root, ["--no-build-isolation", "-e", ".[%s]" % ",".join(extras) if extras else "."])
    with open(stamp_path, "w", encoding="utf-8") as file:
        json.dump(stamp, file)
    if kernels:
        warm_kernels(root)


def warm_kernels(root: str) -> None:
    """Compile the kernels once, so that the nodes of the first cluster need not all do it. Only comfort: it may fail."""
    say("compiling the render kernels, a minute or two")
    with open(os.path.join(root, ".venv", "bootstrap.log"), "ab") as file:
        command = [venv_python(root), "-m", "scenefold.render.warm"]
        if subprocess.call(command, cwd=root, stdout=file, stderr=subprocess.STDOUT, env=clean_environment()):
            say("they will be compiled at the first render instead (why: .venv/bootstrap.log)")


def main(arguments: Optional[List[str]] = None) -> int:
    """Print `ready`, or the problem in one line and return 1."""
    parser = argparse.ArgumentParser(description="Make .venv ready for the Makefile.")
    parser.add_argument("--root", default=ROOT)
    parser.add_argument("--python", default="", help="use this Python and no other")
    parser.add_argument("--extras", default="", help="extras of pyproject.toml, separated by blanks")
    parser.add_argument("--no-kernels", action="store_true", help="leave the render kernels to whoever uses them first")
    options = parser.parse_args(arguments)
    root, extras = os.path.abspath(options.root), options.extras.split()
    try:
        # The stamp is judged again under the lock: another make may just have written it.
        if not is_ready(root, options.python, extras):
            with only_one_at_a_time():
                if not is_ready(root, options.python, extras):
                    bring_up(root, options.python, extras, not options.no_kernels)
    except Problem as problem:
        print(" ".join(str(problem).split()))
        return 1
    except OSError as error:
        print("cannot make .venv: %s: %s" % (error.strerror, error.filename))
        return 1
    except KeyboardInterrupt:
        # make is gone by now, and nobody reads standard output any more.
        say("interrupted: run the same command to go on")
        return 130
    print("ready")
    return 0


if __name__ == "__main__":
    sys.exit(main())
