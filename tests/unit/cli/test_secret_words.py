"""If this fails, a passphrase that cannot be one ends in a traceback, or a token stands in a message."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenectl.member_values import TokenOrAddress
from scenectl.passphrases import VARIABLE, known_passphrase, passphrase_of_file
from scenefold.base.errors import UsageFault


def test_a_variable_that_is_no_text_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "\udcff\udcfe and more")
    with pytest.raises(UsageFault, match="no text in UTF-8"):
        known_passphrase("users/owner")
    monkeypatch.setenv(VARIABLE, "grün und lang genug")
    assert known_passphrase("users/owner") == "grün und lang genug"


@pytest.mark.parametrize(("content", "told"), [("", "holds none"), ("\n\n", "holds none"), ("short\n", "8 to 1024 characters")])
def test_a_file_without_a_passphrase_says_so(content: str, told: str, tmp_path: Path) -> None:
    file = tmp_path / "passphrase"
    file.write_text(content)
    with pytest.raises(UsageFault, match=told):
        passphrase_of_file("keys", file)


def test_a_part_of_a_token_is_not_printed() -> None:
    with pytest.raises(ValueError, match="neither a whole token") as caught:
        TokenOrAddress.parse("krsxg5bo-krsxg5bo")
    assert "krsxg5bo" not in str(caught.value)
    with pytest.raises(ValueError, match=r"'127\.0\.0'"):
        TokenOrAddress.parse("127.0.0")
