"""Requests for certificates: a member makes its key where it is used, and sends only what is public (PKCS #10)."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from gloc3.errors import Finding, InputError
from gloc3.network.authority import KEY, make_key, read_key
from gloc3.store import replace_file

REQUEST: Final = "request.pem"
_GROUP: Final = 4
_GROUPS: Final = 6


def make_request(folder: Path, member: str) -> str:
    """Writes a request into the member's folder, with the key that is there or a new one; returns its fingerprint.

    Raises:
        InputError: the key that is there cannot be used.
    """
    if not (folder / KEY).exists():
        make_key(folder)
    key = read_key(folder / KEY)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, member)])
    request = x509.CertificateSigningRequestBuilder().subject_name(name).sign(key, hashes.SHA256())
    replace_file(folder / REQUEST, request.public_bytes(serialization.Encoding.PEM))
    return fingerprint(key.public_key())


def read_request(path: Path, member: str) -> ec.EllipticCurvePublicKey:
    """The public key in a request, whose sender has shown to have the private one.

    Raises:
        InputError: it is no request, or another member's.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror or error}")]) from error
    return request_key(data, member, str(path))


def request_key(data: bytes, member: str, path: str) -> ec.EllipticCurvePublicKey:
    """The same of a request in memory.

    Args:
        data: the request, PEM.
        member: whose it has to be.
        path: where it comes from, for messages.

    Raises:
        InputError: it is no request, or another member's.
    """
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


def fingerprint(key: ec.EllipticCurvePublicKey) -> str:
    """A public key's fingerprint, short enough to be read out: six groups of four digits."""
    data = key.public_bytes(serialization.Encoding.DER, serialization.PublicFormat.SubjectPublicKeyInfo)
    digest = hashes.Hash(hashes.SHA256())
    digest.update(data)
    digits = digest.finalize().hex()
    return " ".join(digits[at : at + _GROUP] for at in range(0, _GROUP * _GROUPS, _GROUP))
