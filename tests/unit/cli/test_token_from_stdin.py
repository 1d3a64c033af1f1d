"""If this fails, a token has to stand on the command line, where everybody on the machine can read it."""

from __future__ import annotations

import io

import pytest

from scenectl.member_values import TokenOrAddress, given_token
from scenefold.base.errors import UsageFault

TOKEN = "aeayr3k4-" * 12


def test_a_line_of_standard_input_is_the_token() -> None:
    asked = TokenOrAddress.parse("-")
    assert given_token(asked, io.StringIO(f"  {TOKEN}\nmore\n")) == TokenOrAddress(TOKEN)
    assert given_token(TokenOrAddress(TOKEN), io.StringIO("other\n")) == TokenOrAddress(TOKEN)


@pytest.mark.parametrize("given", [None, io.StringIO(""), io.StringIO("\n"), io.StringIO("no token\n")])
def test_without_one_it_says_so(given: io.StringIO | None) -> None:
    with pytest.raises(UsageFault, match="standard input"):
        given_token(TokenOrAddress.parse("-"), given)


@pytest.mark.parametrize("text", ["aeayr3k4", "aeayr3k4-hj2k", "studio", "10.0.0", "999.1.1.1", "", "0.0.0.0"])
def test_what_is_neither_token_nor_address_says_so(text: str) -> None:
    with pytest.raises(ValueError, match="neither a whole token nor an IPv4 address; copy the whole word"):
        TokenOrAddress.parse(text)
