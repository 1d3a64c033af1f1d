"""Where passphrases come from: the environment, a file, or a person at a terminal. Never from arguments, which other users see.

A person is asked outside of Trio, so that Ctrl-C ends the question as it ends anything else: what finds the keys locked raises
PassphraseNeeded, `running.run` asks, and begins again.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from scenectl.output import note
from scenefold.base.errors import LocalFault, UsageFault
from scenefold.crypto.passphrases import PASSPHRASE_CHARACTERS_MAX, PASSPHRASE_CHARACTERS_MIN

VARIABLE = "SCENEFOLD_PASSPHRASE"
_FILE_BYTES_MAX = 4096
_typed: dict[str, str] = {}


class PassphraseNeeded(UsageFault):
    """A person is to be asked for the passphrase of the keys at `where`."""


def known_passphrase(where: str) -> str:
    """That of locked keys, if it was given or typed; PassphraseNeeded if it can be asked for, UsageFault if not."""
    given = os.environ.get(VARIABLE, _typed.get(where))
    if given is not None:
        if any("\udc80" <= letter <= "\udcff" for letter in given):
            # What the system could not read as text.
            raise UsageFault("the passphrase is no text in UTF-8", where=VARIABLE, remedy="set it anew")
        return given
    what, remedy = "these keys are locked, and no passphrase was given", f"give it in {VARIABLE}, or call from a terminal"
    raise (PassphraseNeeded if _is_person_there() else UsageFault)(what, where=where, remedy=remedy)


def ask_person(needed: PassphraseNeeded) -> None:
    """Ask, and remember the answer for this process."""
    _typed[needed.where] = _asked(f"Passphrase of {needed.where}: ")


def present_passphrase(where: str) -> str:
    """That of keys which are locked; UsageFault if nobody can be asked."""
    try:
        return known_passphrase(where)
    except PassphraseNeeded as needed:
        ask_person(needed)
        return known_passphrase(where)


def passphrase_of_file(where: str, file: Path | None) -> str:
    """That of a file of keys which is to be opened."""
    if file is not None:
        return _first_line(file)
    if not _is_person_there():
        raise UsageFault("no passphrase was given", where=where, remedy="name a file that holds it with --passphrase-file")
    return _asked(f"Passphrase of {where}: ")


def new_passphrase(what: str, file: Path | None) -> str:
    """One for what is to be locked: from a file, or typed twice."""
    if file is not None:
        return _first_line(file)
    if not _is_person_there():
        raise UsageFault("no passphrase was given", where=what, remedy="name a file that holds it with --passphrase-file")
    first = _asked(f"New passphrase for {what}: ")
    if _asked("Once more: ") != first:
        raise UsageFault("the two are not the same", where=what, remedy="try again; nothing was changed")
    return first


def _is_person_there() -> bool:
    return sys.stdin is not None and sys.stdin.isatty()


def _asked(prompt: str) -> str:
    import getpass

    try:
        return getpass.getpass(prompt, stream=sys.stderr)
    except (EOFError, KeyboardInterrupt) as end:
        # The cursor still stands behind the prompt.
        note("")
        if isinstance(end, KeyboardInterrupt):
            raise
        raise UsageFault("no passphrase was typed", remedy="try again; nothing was changed") from None


def _first_line(file: Path) -> str:
    try:
        with file.open("rb") as opened:
            data = opened.read(_FILE_BYTES_MAX + 1)
    except OSError as error:
        raise LocalFault(
            f"cannot read the passphrase: {error.strerror}", where=str(file), remedy="check its name and permissions"
        ) from error
    if len(data) > _FILE_BYTES_MAX:
        raise LocalFault("far too large for a passphrase", where=str(file), remedy="put it on the first line of a file of its own")
    try:
        lines = data.decode().splitlines()
    except UnicodeDecodeError:
        raise LocalFault("the passphrase is no text in UTF-8", where=str(file), remedy="write it anew") from None
    if not lines or not lines[0]:
        raise UsageFault("the file of a passphrase holds none", where=str(file), remedy="put it on the first line")
    if not PASSPHRASE_CHARACTERS_MIN <= len(lines[0]) <= PASSPHRASE_CHARACTERS_MAX:
        what = f"a passphrase has {PASSPHRASE_CHARACTERS_MIN} to {PASSPHRASE_CHARACTERS_MAX} characters, not {len(lines[0])}"
        raise UsageFault(what, where=str(file), remedy="it is the first line that counts")
    return lines[0]
