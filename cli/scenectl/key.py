"""`scenectl key`: look at one's keys, lock them, back them up, and take them to another computer."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import App, Parameter

from scenectl.names import UserName
from scenectl.output import DEFAULT_PROFILE, ProfileOutput, emit, table

if TYPE_CHECKING:
    from scenefold.client.own_keys import OwnKeys
    from scenefold.world.key_archive import Taken

app = App(name="key", help="Look at your keys, lock them, back them up, and take them along.", help_format="plaintext")


@app.command
def show(*, user: UserName | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Show who you are in the profile, your keys' fingerprints, and how long your certificate is valid. No secret is shown.

    Example: scenectl key show --profile studio

    Parameters
    ----------
    user
        Of which user; by default the one whose keys clients of this profile take.
    """
    from scenectl.passphrases import present_passphrase
    from scenefold.client.own_keys import own_keys

    keys = own_keys(output.profile, user, present_passphrase)
    emit(output, keys.document(), _text(keys))


@app.command
def passphrase(
    *,
    remove: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    passphrase_file: Path | None = None,
    user: UserName | None = None,
    output: ProfileOutput = DEFAULT_PROFILE,
) -> None:
    """Lock your keys in the profile with a passphrase, change it, or remove it.

    Every command asks for it from then on, or takes it from SCENEFOLD_PASSPHRASE.

    Example: scenectl key passphrase --profile studio

    Parameters
    ----------
    remove
        Leave the keys as plain files, which only you may read.
    passphrase_file
        File whose first line is the new passphrase; by default you are asked for it.
    user
        Of which user; by default the one whose keys clients of this profile take.
    """
    from scenectl.passphrases import new_passphrase, present_passphrase
    from scenefold.client.own_keys import set_passphrase

    def wanted() -> str:
        return new_passphrase("your keys", passphrase_file)

    folder = set_passphrase(output.profile, user, None if remove else wanted, present_passphrase)
    document = {"folder": str(folder), "locked": not remove}
    emit(output, document, f"The keys in {folder} are {'no longer locked' if remove else 'locked'}.")


@app.command
def backup(file: Path, /, *, passphrase_file: Path | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Write all that the profile holds, but for keys of nodes, to one file locked by a passphrase.

    Who has that file and its passphrase has your scenes, and the right to admit members if this profile has it.

    Example: scenectl key backup studio-keys.txt --profile studio

    Parameters
    ----------
    file
        The file to write; it must not exist.
    passphrase_file
        File whose first line is the passphrase of the backup; by default you are asked for it.
    """
    _write(file, None, passphrase_file, output)


@app.command
def export(
    file: Path, /, *, user: UserName | None = None, passphrase_file: Path | None = None, output: ProfileOutput = DEFAULT_PROFILE
) -> None:
    """Write your identity alone to a file locked by a passphrase, to work from another computer as well.

    It holds no scenes and not the authority's key.

    Example: scenectl key export me.txt --profile studio

    Parameters
    ----------
    file
        The file to write; it must not exist.
    user
        Which user; by default the one whose keys clients of this profile take.
    passphrase_file
        File whose first line is the passphrase of the file; by default you are asked for it.
    """
    from scenefold.client.own_keys import user_of

    _write(file, user_of(output.profile, user), passphrase_file, output)


@app.command(name="import")
def import_(file: Path, /, *, passphrase_file: Path | None = None, output: ProfileOutput = DEFAULT_PROFILE) -> None:
    """Put back what `key backup` or `key export` wrote, into a new profile or one of the same cluster.

    Nothing that is there is overwritten. Your keys stay locked, by the passphrase of the file; `key passphrase` changes that.

    Example: scenectl key import studio-keys.txt --profile studio

    Parameters
    ----------
    file
        A file that `key backup` or `key export` wrote.
    passphrase_file
        File whose first line is the passphrase of that file; by default you are asked for it.
    """
    from scenectl.passphrases import passphrase_of_file
    from scenefold.client.own_keys import put_back

    folder, taken = put_back(file, output.profile, lambda: passphrase_of_file(str(file), passphrase_file))
    emit(output, {"profile": str(folder), **_document(taken)}, f"In {folder} there is now {_words(taken)}; your keys there are locked.")


def _write(file: Path, user: str | None, passphrase_file: Path | None, output: ProfileOutput) -> None:
    from scenectl.passphrases import new_passphrase, present_passphrase
    from scenefold.client.own_keys import write_keys

    taken = write_keys(output.profile, file, user, lambda: new_passphrase(str(file), passphrase_file), present_passphrase)
    text = f"{file} holds {_words(taken)}. Keep it and its passphrase in different places: one is worth nothing without the other."
    emit(output, {"file": str(file), **_document(taken)}, text)


def _document(taken: Taken) -> dict[str, Any]:
    return {
        "kind": taken.kind,
        "cluster": taken.cluster,
        "users": list(taken.users),
        "scenes": taken.scenes,
        "authority_key": taken.has_authority_key,
    }


def _words(taken: Taken) -> str:
    parts = [f"the identity of {', '.join(taken.users)} in {taken.cluster}"]
    if taken.scenes:
        parts.append(f"keys of {taken.scenes} scene{'s' if taken.scenes > 1 else ''}")
    if taken.has_authority_key:
        parts.append("the authority's key")
    return ", ".join(parts[:-1]) + (" and " if len(parts) > 1 else "") + parts[-1]


def _text(keys: OwnKeys) -> str:
    rows = [
        ("user", keys.user),
        ("cluster", keys.cluster),
        ("role", "administrator" if keys.is_administrator else "user"),
        ("suite", keys.suite),
        ("signing key", f"{keys.signing_id:08x}  {keys.signing_fingerprint}"),
        ("sealing key", f"{keys.sealing_id:08x}  {keys.sealing_fingerprint}"),
        ("valid", f"{keys.not_before:%Y-%m-%d} to {keys.not_after:%Y-%m-%d}"),
        ("passphrase", "locked" if keys.is_locked else "none: scenectl key passphrase"),
        ("folder", str(keys.folder)),
    ]
    return table(("", ""), rows).strip("\n")
