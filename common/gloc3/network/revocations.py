"""The list of revoked certificates: an X.509 CRL, signed by the network's authority, numbered, and valid until an end."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime
from pathlib import Path
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding

from gloc3.clock import utc_text
from gloc3.errors import Finding, InputError, Refused
from gloc3.network.authority import AUTHORITY, AUTHORITY_KEY, number_of, read_certificate, read_key
from gloc3.store import replace_file

REVOCATIONS: Final = "revocations.pem"
MOST_BYTES: Final = 64_000
"""Longest list that is accepted, bytes: some 1,500 certificates."""


class RevocationList(NamedTuple):
    """A list whose signature has been verified."""

    number: int
    """A later list has a higher one."""
    certificates: frozenset[str]
    """Numbers of the revoked certificates."""
    signed_s: float
    """When the authority signed it, UTC, s."""
    end_s: float
    """Until when it counts as up to date, UTC, s."""
    data: bytes
    """The list itself, DER."""

    def __str__(self) -> str:
        return f"list {self.number} of revoked members, signed on {utc_text(self.signed_s)} UTC"


def sign_list(folder: Path, revoked: Iterable[int], now: datetime, until: datetime | None = None) -> RevocationList:
    """Writes the next list of a network.

    Args:
        folder: folder of the authority, with the list before.
        revoked: serial numbers of certificates that are revoked, besides those in the list before.
        now: time of signing.
        until: until when it counts as up to date; None for the end of the authority's certificate.

    Raises:
        InputError: the authority's key, or the list before, cannot be used.
    """
    authority, path = read_certificate(folder / AUTHORITY), folder / REVOCATIONS
    before = read_list(path, authority) if path.exists() else None
    entries = list(x509.load_der_x509_crl(before.data)) if before is not None else []
    number = before.number + 1 if before is not None else 1
    builder = (
        x509.CertificateRevocationListBuilder()
        .issuer_name(authority.subject)
        .last_update(now)
        .next_update(until or max(authority.not_valid_after_utc, now))
        .add_extension(x509.CRLNumber(number), critical=False)
    )
    known = {entry.serial_number for entry in entries}
    for serial in sorted(set(revoked) - known):
        entries.append(x509.RevokedCertificateBuilder().serial_number(serial).revocation_date(now).build())
    for entry in entries:
        builder = builder.add_revoked_certificate(entry)
    signed = builder.sign(read_key(folder / AUTHORITY_KEY), hashes.SHA256())
    replace_file(path, signed.public_bytes(Encoding.PEM))
    return verify_list(signed.public_bytes(Encoding.DER), authority)


def read_list(path: Path, authority: x509.Certificate) -> RevocationList:
    """A list in a file.

    Raises:
        InputError: it cannot be read, or is not of the network's authority.
    """
    try:
        data = x509.load_pem_x509_crl(path.read_bytes()).public_bytes(Encoding.DER)
        return verify_list(data, authority)
    except OSError as error:
        raise InputError([Finding(file=str(path), message=f"cannot be read: {error.strerror or error}")]) from error
    except ValueError as error:
        raise InputError([Finding(file=str(path), message="not a list of revoked certificates (PEM)")]) from error
    except Refused as error:
        raise InputError([Finding(file=str(path), message=str(error))]) from error


def write_list(path: Path, found: RevocationList) -> None:
    """Keeps a list in a file.

    Raises:
        OSError: it cannot be written.
    """
    replace_file(path, x509.load_der_x509_crl(found.data).public_bytes(Encoding.PEM))


def verify_list(data: bytes, authority: x509.Certificate) -> RevocationList:
    """Verifies the signature of a list.

    Args:
        data: the list, DER.
        authority: certificate of the network's authority.

    Raises:
        Refused: it is too long, no list, or not signed by the authority.
    """
    if len(data) > MOST_BYTES:
        raise Refused(f"a list of revoked members has {len(data)} bytes, at most {MOST_BYTES}")
    key = authority.public_key()
    assert isinstance(key, ec.EllipticCurvePublicKey)
    try:
        found = x509.load_der_x509_crl(data)
        is_ours = found.issuer == authority.subject and found.is_signature_valid(key)
        number = found.extensions.get_extension_for_class(x509.CRLNumber).value.crl_number
        end = found.next_update_utc
    except (ValueError, TypeError, x509.ExtensionNotFound):
        is_ours, number, end = False, 0, None
    if not is_ours or end is None:
        raise Refused("a list of revoked members is not signed by this network's authority")
    certificates = frozenset(number_of(entry.serial_number) for entry in found)
    return RevocationList(number, certificates, found.last_update_utc.timestamp(), end.timestamp(), data)
