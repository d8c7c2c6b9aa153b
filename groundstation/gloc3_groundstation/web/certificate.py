"""TLS for the station's pages: a certificate and key in files, or a self-signed pair that is made when it is needed."""

import ssl
from datetime import datetime, timedelta
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path
from socket import gethostname
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from gloc3.errors import Refused
from gloc3.store import write_secret

VALID: Final = timedelta(days=397)
"""Life of a self-signed certificate; browsers accept no longer one."""
SPARE: Final = timedelta(days=7)
"""Remaining life below which a new one is made."""
NAMES: Final = ("station.crt", "station.key")


def load_pair(certificate: Path, key: Path) -> ssl.SSLContext:
    """The context of a server with a certificate.

    Raises:
        Refused: a file cannot be read, or the two do not belong together.
    """
    context = ssl.create_default_context(ssl.Purpose.CLIENT_AUTH)
    try:
        context.load_cert_chain(certificate, key, password=_no_password)
    except OSError as error:  # an SSLError is one
        reason = error.strerror or str(error)
        if isinstance(error, ssl.SSLError):
            reason = (error.reason or reason).lower().replace("_", " ")
        raise Refused(f"--web-tls {certificate},{key}: {reason}") from error
    return context


def fingerprint(certificate: Path) -> str:
    """SHA-256 of the first certificate in a file, as browsers show it.

    Raises:
        Refused: there is none.
    """
    try:
        loaded = x509.load_pem_x509_certificate(certificate.read_bytes())
    except (OSError, ValueError) as error:
        raise Refused(f"--web-tls: {certificate} holds no certificate (PEM)") from error
    return sha256(loaded.public_bytes(serialization.Encoding.DER)).digest().hex(":").upper()


def self_signed(folder: Path, host: str, now: datetime) -> tuple[Path, Path]:
    """Certificate and key for an address; those in a folder while they are valid for it, else new ones there.

    Raises:
        Refused: they cannot be written.
    """
    certificate, key = (folder / name for name in NAMES)
    names = ["localhost", gethostname(), host]
    if not _is_usable(certificate, key, host, now):
        private = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "GLOC3 ground station")])
        built = (
            x509.CertificateBuilder()
            .subject_name(subject)
            .issuer_name(subject)
            .public_key(private.public_key())
            .serial_number(x509.random_serial_number())
            .not_valid_before(now - timedelta(days=1))
            .not_valid_after(now + VALID - timedelta(days=1))
            .add_extension(
                x509.SubjectAlternativeName([_alternative(name) for name in dict.fromkeys(names)]), critical=False
            )
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .sign(private, hashes.SHA256())
        )
        secret = private.private_bytes(
            serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
        )
        try:
            folder.mkdir(parents=True, exist_ok=True)
            key.unlink(missing_ok=True)
            write_secret(key, secret)
            certificate.write_bytes(built.public_bytes(serialization.Encoding.PEM))
        except OSError as error:
            raise Refused(f"--web-tls: {folder} cannot be written: {error.strerror}") from error
    return certificate, key


def _is_usable(certificate: Path, key: Path, host: str, now: datetime) -> bool:
    try:
        loaded = x509.load_pem_x509_certificate(certificate.read_bytes())
        private = serialization.load_pem_private_key(key.read_bytes(), None)
        names = loaded.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    except (OSError, ValueError, x509.ExtensionNotFound):
        return False
    is_valid = loaded.not_valid_before_utc <= now < loaded.not_valid_after_utc - SPARE
    return is_valid and loaded.public_key() == private.public_key() and _alternative(host) in names


def _alternative(name: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _no_password() -> str:
    """Has a key with a password refused, instead of asking for it in the terminal."""
    return ""
