import pytest

from services.access.enrolment_protocol import PORT, Token, parse_address


def test_a_token_is_read_as_it_was_printed() -> None:
    token = Token("r4", "secret", "fingerprint")
    assert Token.parse(f" {token}\n") == token


@pytest.mark.parametrize("text", ["", "r4", "r4:secret", "r4:a:b:c", "../ca:a:b", "r 4:a:b"])
def test_what_is_no_token_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="copy all that `fleetsight pki invite` printed"):
        Token.parse(text)


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("central", ("central", PORT)),
        ("central:1", ("central", 1)),
        ("10.0.0.1:65535", ("10.0.0.1", 65_535)),
        ("[::1]", ("::1", PORT)),
        ("[::1]:1", ("::1", 1)),
    ],
)
def test_an_address_has_a_port(text: str, address: tuple[str, int]) -> None:
    assert parse_address(text) == address


@pytest.mark.parametrize("text", ["", ":1", "central:", "central:x", "central:65536", "::1", "tls/central:1", "[]:1"])
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="write it like central:7448"):
        parse_address(text)
