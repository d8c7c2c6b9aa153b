"""Requests for certificates: a member makes its key where it is used, and sends only what is public (PKCS #10)."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from gloc3.errors import Finding, InputError
from gloc3.network.authority import KEY, make_key, read_key
from gloc3.network.security_token import TOKEN, TokenKey
from gloc3.store import replace_file

REQUEST: Final = "request.pem"
_GROUP: Final = 4
_GROUPS: Final = 6


class RequestedKeys(NamedTuple):
    """The public keys in a request, whose sender has shown to have the private ones."""

    link: ec.EllipticCurvePublicKey
    """Of the member's links."""
    signing: ec.EllipticCurvePublicKey | None = None
    """In a token, which signs its requests; None where the same key does."""


def make_request(folder: Path, member: str, token: str = "") -> str:
    """Writes a request into the member's folder, with the keys that are there or new ones; returns their fingerprint.

    Args:
        folder: the member's.
        member: its name.
        token: URI of a token, in which the key that signs its requests is or is to be; empty for none.

    Raises:
        Refused: the token cannot be used.
        InputError: the key that is there cannot be used.
    """
    signing = TokenKey(token, is_made=True) if token else None
    if not (folder / KEY).exists():
        make_key(folder)
    key = read_key(folder / KEY)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, member)])
    builder = x509.CertificateSigningRequestBuilder().subject_name(name)
    requests = [builder.sign(one, hashes.SHA256()) for one in (key, signing) if one is not None]
    replace_file(folder / REQUEST, b"".join(one.public_bytes(serialization.Encoding.PEM) for one in requests))
    if signing is None:
        (folder / TOKEN).unlink(missing_ok=True)
    else:
        replace_file(folder / TOKEN, f"{token}\n".encode())
    return fingerprint(RequestedKeys(key.public_key(), None if signing is None else signing.public_key()))


def read_request(path: Path, member: str) -> RequestedKeys:
    """The keys in a request.

    Raises:
        InputError: it is no request, or another member's.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror or error}")]) from error
    return requested_keys(data, member, str(path))


def requested_keys(data: bytes, member: str, path: str) -> RequestedKeys:
    """The same of a request in memory.

    Args:
        data: the request, PEM.
        member: whose it has to be.
        path: where it comes from, for messages.

    Raises:
        InputError: it is no request, or another member's.
    """
    first, *others = re.findall(rb"-----BEGIN.*?-----END[^\n]*", data, re.DOTALL) or [data]
    if len(others) > 1:
        raise InputError([Finding(file=path, message="more than two requests: send request.pem as it is")])
    return RequestedKeys(_key_in(first, member, path), *(_key_in(other, member, path) for other in others))


def _key_in(data: bytes, member: str, path: str) -> ec.EllipticCurvePublicKey:
    try:
        request = x509.load_pem_x509_csr(data)
    except ValueError as error:
        raise InputError([Finding(file=path, message="not a request (gloc3 network request makes one)")]) from error
    key = request.public_key()
    if not request.is_signature_valid or not isinstance(key, ec.EllipticCurvePublicKey):
        raise InputError([Finding(file=path, message="its signature is wrong: it was changed on the way")])
    if key.curve.name != ec.SECP256R1.name:
        raise InputError([Finding(file=path, message=f"its key is of {key.curve.name}, not of P-256")])
    names = request.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if [name.value for name in names] != [member]:
        asked = ", ".join(str(name.value) for name in names) or "nobody"
        raise InputError([Finding(file=path, message=f"it is of {asked}, not of {member}")])
    return key


def fingerprint(keys: RequestedKeys) -> str:
    """The fingerprint of a member's public keys, short enough to be read out: six groups of four digits."""
    digest = hashes.Hash(hashes.SHA256())
    for key in filter(None, keys):
        digest.update(key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo))
    digits = digest.finalize().hex()
    return " ".join(digits[at : at + _GROUP] for at in range(0, _GROUP * _GROUPS, _GROUP))
