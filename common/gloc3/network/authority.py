"""The network's own certificate authority, and the certificates of its members (X.509, ECDSA P-256)."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from gloc3.cli.counting import counted
from gloc3.errors import Finding, InputError
from gloc3.network.access import common_name
from gloc3.store import write_secret

CERTIFICATE: Final = "certificate.pem"
KEY: Final = "key.pem"
SIGNING: Final = "signing.pem"
"""The certificate of a station's key in a token, which signs its requests; its links use the other key."""
AUTHORITY: Final = "authority.pem"
AUTHORITY_KEY: Final = "authority.key"
NUMBER_DIGITS: Final = 8
RENEWED_BEFORE: Final = timedelta(days=30)
"""Certificates that expire within this time are reported, and renewed by default."""
BACKDATED: Final = timedelta(days=1)
"""How long before their creation certificates are valid, for computers whose clocks are behind."""


def make_authority(folder: Path, network: str, now: datetime, valid: timedelta) -> None:
    """Writes the authority's certificate and key, which stays where it is made."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, f"{network} authority")])
    certificate = (
        _builder(name, name, key.public_key(), x509.random_serial_number(), now, valid)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(is_authority=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    write_secret(folder / AUTHORITY_KEY, _key_bytes(key))
    (folder / AUTHORITY).write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def make_temporary(folder: Path, now: datetime, valid: timedelta) -> None:
    """Writes a certificate that signs itself and its key, for a TLS server that is recognized by a digest."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "invitation")])
    certificate = (
        _builder(name, name, key.public_key(), x509.random_serial_number(), now, valid)
        .add_extension(_usage(is_authority=False), critical=True)
        .sign(key, hashes.SHA256())
    )
    write_secret(folder / KEY, _key_bytes(key))
    (folder / CERTIFICATE).write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


class CertificateSubject(NamedTuple):
    """Whom a certificate is for."""

    member: str
    """Its name."""
    hosts: Sequence[str]
    """Its names and addresses."""
    key: ec.EllipticCurvePublicKey


def make_key(into: Path) -> ec.EllipticCurvePublicKey:
    """Writes a new key into a member's folder; returns its public part.

    Raises:
        Refused: there is a key already.
    """
    key = ec.generate_private_key(ec.SECP256R1())
    into.mkdir(mode=0o700, parents=True, exist_ok=True)
    write_secret(into / KEY, _key_bytes(key))
    return key.public_key()


def issue(folder: Path, into: Path, subject: CertificateSubject, now: datetime, valid: timedelta) -> str:
    """Creates a member's certificate.

    Args:
        folder: folder of the authority.
        into: output file; the authority's certificate is written beside it.
        subject: whom it is for.
        now: the validity starts slightly earlier.
        valid: duration of the validity.

    Returns:
        The certificate's number.

    Raises:
        InputError: the authority's key cannot be used.
    """
    authority = read_certificate(folder / AUTHORITY)
    signer = read_key(folder / AUTHORITY_KEY)
    serial = x509.random_serial_number()
    number = number_of(serial)
    member = subject.member
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name(member, number))])
    certificate = (
        _builder(name, authority.subject, subject.key, serial, now, valid)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(is_authority=False), critical=True)
        .add_extension(
            x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]), critical=False
        )
        .add_extension(x509.SubjectAlternativeName([_place(host) for host in (member, *subject.hosts)]), critical=False)
        .sign(signer, hashes.SHA256())
    )
    into.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    into.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    (into.parent / AUTHORITY).write_bytes((folder / AUTHORITY).read_bytes())
    return number


def read_certificate(path: Path) -> x509.Certificate:
    """A certificate.

    Raises:
        InputError: there is none.
    """
    try:
        return x509.load_pem_x509_certificate(path.read_bytes())
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror or error}")]) from error
    except ValueError as error:
        raise InputError([Finding(file=str(path), message="not a certificate (PEM)")]) from error


def public_key(certificate: x509.Certificate) -> ec.EllipticCurvePublicKey:
    """The public key of a certificate of this network: always one of P-256."""
    key = certificate.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    return key


def number_of(serial: int) -> str:
    """The number of a certificate, as members' names have it: the end of its serial number."""
    return f"{serial:0{NUMBER_DIGITS}x}"[-NUMBER_DIGITS:]


def name_of(certificate: x509.Certificate) -> str:
    """The certificate's common name; empty where it has none."""
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(names[0].value) if names else ""


def findings(certificate: Path, key: Path | None, authority: Path, wanted: str, now: datetime) -> list[Finding]:
    """What is wrong with a member's certificate and its key, unless that is in a token."""
    found = []
    try:
        own, root = read_certificate(certificate), read_certificate(authority)
        private = None if key is None else read_key(key)
    except InputError as error:
        return list(error.findings)
    try:
        own.verify_directly_issued_by(root)
    except (ValueError, TypeError, InvalidSignature):
        found.append(Finding(file=str(certificate), message=f"{authority.name} has not signed this certificate"))
    if private is not None and own.public_key() != private.public_key():
        found.append(Finding(file=str(key), message=f"this is not the key of {certificate.name}"))
    if name_of(own) != wanted:
        found.append(Finding(file=str(certificate), message=f"it belongs to {name_of(own)!r}, not to {wanted!r}"))
    for path, each in ((certificate, own), (authority, root)):
        if now > each.not_valid_after_utc:
            found.append(
                Finding(
                    file=str(path),
                    message=f"it expired on {each.not_valid_after_utc:%Y-%m-%d}",
                    hint="renew it: gloc3 network renew",
                )
            )
        elif now < each.not_valid_before_utc:
            found.append(
                Finding(
                    file=str(path),
                    message=f"it is valid only from {each.not_valid_before_utc:%Y-%m-%d}",
                    hint="is this computer's clock right?",
                )
            )
    return found


def expiry(certificate: Path, now: datetime) -> str:
    """A warning of a certificate that expires soon; empty where it does not.

    Raises:
        InputError: there is no certificate.
    """
    end = read_certificate(certificate).not_valid_after_utc
    if end - now > RENEWED_BEFORE:
        return ""
    days = max((end - now).days, 0)
    return f"{certificate} expires on {end:%Y-%m-%d}, in {counted(days, 'day')}: gloc3 network renew"


def read_key(path: Path) -> ec.EllipticCurvePrivateKey:
    """A private key that only its owner can read.

    Raises:
        InputError: there is none, or others can read it.
    """
    try:
        mode = path.stat().st_mode
        data = path.read_bytes()
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror or error}")]) from error
    if mode & 0o077:
        message = f"other users can access this key (mode {mode & 0o7777:04o})"
        hint = f"chmod 600 {path}; if it may have been read, revoke it and make another"
        raise InputError([Finding(file=str(path), message=message, hint=hint)])
    try:
        key = serialization.load_pem_private_key(data, None)
    except (ValueError, TypeError) as error:
        raise InputError([Finding(file=str(path), message="not a private key (PEM)")]) from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise InputError([Finding(file=str(path), message="this key is not an ECDSA key")])
    return key


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, serial: int, now: datetime, valid: timedelta
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(serial)
        .not_valid_before(min(now, now + valid) - BACKDATED)
        .not_valid_after(now + valid)
    )


def _usage(*, is_authority: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not is_authority,
        key_cert_sign=is_authority,
        crl_sign=is_authority,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _key_bytes(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )


def _place(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)
