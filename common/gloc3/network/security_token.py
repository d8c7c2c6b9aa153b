"""Keys in security tokens, which sign and never reveal them: smart cards, USB tokens, a TPM (PKCS #11, RFC 7512)."""

from __future__ import annotations

import getpass
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any, Final, NamedTuple, NoReturn
from urllib.parse import unquote

from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.asymmetric.utils import encode_dss_signature

from gloc3.errors import Finding, InputError, Refused

TOKEN: Final = "token.uri"
"""The file with the token's URI in a member's folder."""
PIN_VARIABLE: Final = "GLOC3_TOKEN_PIN"
EXAMPLE: Final = "pkcs11:token=alice?module-path=/usr/lib/softhsm/libsofthsm2.so"
_SCHEME: Final = "pkcs11:"
_LABEL: Final = "gloc3"
_ATTRIBUTES: Final = ("token", "serial", "object", "module-path", "pin-source")
_HALF: Final = 32
"""Bytes of each number of a signature by P-256."""


class TokenPlace(NamedTuple):
    """Where a key is, as a PKCS #11 URI tells it."""

    module: str
    """The library of the token's maker."""
    token: str
    """The token's label."""
    serial: str = ""
    """Its serial number; empty for any."""
    key: str = _LABEL
    """The key's label."""
    pin_source: str = ""
    """The file with the PIN; empty for the environment or the keyboard."""

    @classmethod
    def read(cls, uri: str) -> TokenPlace:
        """The place in a URI.

        Raises:
            Refused: it is none, or has too little or too much in it.
        """
        if not uri.startswith(_SCHEME):
            raise Refused(f"{uri!r} is no PKCS #11 URI; for example {EXAMPLE}")
        path, _, query = uri.removeprefix(_SCHEME).partition("?")
        found: dict[str, str] = {}
        for part in filter(None, (*path.split(";"), *query.split("&"))):
            name, _, value = part.partition("=")
            if name == "pin-value":
                raise Refused("a PIN in the URI can be read by everyone; write pin-source=file:/a/file of mode 600")
            if name not in _ATTRIBUTES:
                raise Refused(f"{name} is not known here; known are {', '.join(_ATTRIBUTES)}")
            found[name] = unquote(value)
        missing = [name for name in ("token", "module-path") if not found.get(name)]
        if missing:
            raise Refused(f"{uri!r} has no {' and no '.join(missing)}; for example {EXAMPLE}")
        source = found.get("pin-source", "").removeprefix("file:")
        return cls(found["module-path"], found["token"], found.get("serial", ""), found.get("object", _LABEL), source)


class TokenKey(ec.EllipticCurvePrivateKey):
    """A private key of P-256 in a token.

    Args:
        uri: where it is.
        is_made: a new one is made there if there is none.

    Raises:
        Refused: there is no such token or key, or its PIN is wrong.
    """

    def __init__(self, uri: str, *, is_made: bool = False) -> None:
        self._place = TokenPlace.read(uri)
        self._pin = ""
        self._key: Any = None
        self._public = self._open(is_made=is_made)

    @property
    def curve(self) -> ec.EllipticCurve:
        """P-256."""
        return ec.SECP256R1()

    @property
    def key_size(self) -> int:
        """Its size in bits."""
        return self.curve.key_size

    def public_key(self) -> ec.EllipticCurvePublicKey:
        """The public part."""
        return self._public

    def sign(self, data: Any, signature_algorithm: ec.EllipticCurveSignatureAlgorithm) -> bytes:
        """The ECDSA signature of data, with SHA-256, in DER.

        Raises:
            Refused: the token does not sign: it was removed, or wants its PIN again.
        """
        import pkcs11

        digest = sha256(data).digest()
        with self._refusing():
            if self._key is None:
                self._open()
            try:
                numbers = bytes(self._key.sign(digest, mechanism=pkcs11.Mechanism.ECDSA))
            except pkcs11.PKCS11Error:
                self._key = None  # it may have been plugged out and in: opened again for the next one
                raise
        return encode_dss_signature(int.from_bytes(numbers[:_HALF], "big"), int.from_bytes(numbers[_HALF:], "big"))

    def _open(self, *, is_made: bool = False) -> ec.EllipticCurvePublicKey:
        try:
            import pkcs11
            from pkcs11.util.ec import encode_ec_public_key, encode_named_curve_parameters
        except ModuleNotFoundError as error:
            raise Refused('keys in tokens need python-pkcs11: pip install "gloc3[token]"') from error
        place = self._place
        with self._refusing():
            found = pkcs11.lib(place.module).get_token(
                token_label=place.token, token_serial=place.serial.encode() or None
            )
            self._pin = self._pin or _pin(place)
            try:
                session = found.open(user_pin=self._pin, rw=is_made)
            except pkcs11.exceptions.UserAlreadyLoggedIn:
                session = found.open(rw=is_made)
            try:
                public: Any = session.get_key(pkcs11.ObjectClass.PUBLIC_KEY, pkcs11.KeyType.EC, place.key)
                self._key = session.get_key(pkcs11.ObjectClass.PRIVATE_KEY, pkcs11.KeyType.EC, place.key)
            except pkcs11.NoSuchKey:
                if not is_made:
                    raise Refused(
                        f"the token {place.token} has no key {place.key!r}: gloc3 network request --token"
                    ) from None
                parameters = {pkcs11.Attribute.EC_PARAMS: encode_named_curve_parameters("secp256r1")}
                group = session.create_domain_parameters(pkcs11.KeyType.EC, parameters, local=True)
                public, self._key = group.generate_keypair(store=True, label=place.key)
            key = serialization.load_der_public_key(encode_ec_public_key(public))
        if not isinstance(key, ec.EllipticCurvePublicKey) or key.curve.name != self.curve.name:
            raise Refused(f"the key {place.key!r} of the token {place.token} is not of P-256")
        return key

    @contextmanager
    def _refusing(self) -> Iterator[None]:
        """Tells what the token's library has found, in its words where there are any."""
        import pkcs11

        place = self._place
        try:
            yield
        except pkcs11.NoSuchToken:
            raise Refused(f"there is no token {place.token!r}: is it plugged in?") from None
        except pkcs11.PinIncorrect:
            raise Refused(f"the PIN of the token {place.token} is wrong; it locks after a few wrong ones") from None
        except pkcs11.PKCS11Error as error:
            raise Refused(f"the token {place.token}: {str(error) or type(error).__name__}") from error

    def exchange(self, algorithm: ec.ECDH, peer_public_key: ec.EllipticCurvePublicKey) -> bytes:
        """Not for this key: it signs."""
        _only_signs()

    def private_numbers(self) -> ec.EllipticCurvePrivateNumbers:
        """Not for this key: it stays in the token."""
        _only_signs()

    def private_bytes(self, *_: object) -> bytes:
        """Not for this key: it stays in the token."""
        _only_signs()

    def __copy__(self) -> TokenKey:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> TokenKey:
        return self


def read_token_key(folder: Path) -> TokenKey:
    """The key in the token that a member's folder names.

    Raises:
        Refused: it cannot be used.
        InputError: the folder names no token.
    """
    path = folder / TOKEN
    try:
        uri = path.read_text().strip()
    except OSError as error:
        hint = "it is in the folder where the request was made: gloc3 network request --token"
        raise InputError(
            [Finding(file=str(path), message=f"cannot be read: {error.strerror or error}", hint=hint)]
        ) from error
    return TokenKey(uri)


def _pin(place: TokenPlace) -> str:
    if place.pin_source:
        path = Path(place.pin_source)
        try:
            if path.stat().st_mode & 0o077:
                raise Refused(f"other users can read the PIN in {path}: chmod 600 {path}")
            return path.read_text().strip()
        except OSError as error:
            raise Refused(f"{path} with the token's PIN cannot be read: {error.strerror or error}") from error
    if pin := os.environ.get(PIN_VARIABLE, ""):
        return pin
    if not sys.stdin.isatty():
        raise Refused(f"the token {place.token} wants its PIN: pin-source=file:… in its URI, or {PIN_VARIABLE}")
    return getpass.getpass(f"PIN of the token {place.token}: ")


def _only_signs() -> NoReturn:
    raise NotImplementedError("a key in a token only signs")
