"""Signatures of stations' messages: made with the key of the member's certificate, verified on the vehicle.

Certificates go along, so that a vehicle needs only the authority's and the numbers of the members that it accepts.
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final

import msgspec
from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.serialization import Encoding

from gloc3.errors import Refused
from gloc3.messages.envelope import Envelope, SignedMessage
from gloc3.messages.wire import TypeRegistry, type_name
from gloc3.network.authority import name_of, public_key

PURPOSE: Final = "gloc3 request 1"
"""First in what is signed, so that a signature for something else is none for a request."""
MOST_CERTIFICATES: Final = 64
"""Verified certificates that are remembered."""


class RequestSigner:
    """Signs a member's messages.

    Args:
        key: the key of its certificate, in a file or in a token.
        certificate: the certificate.
    """

    def __init__(self, key: ec.EllipticCurvePrivateKey, certificate: x509.Certificate) -> None:
        self._key, self._certificate = key, certificate.public_bytes(Encoding.DER)

    def sign(
        self, envelope: Envelope[Any], types: TypeRegistry, *, until_s: float, boot: int, utc_s: float
    ) -> Envelope[SignedMessage]:
        """A message as it is sent, on the same topic.

        Args:
            envelope: the message, on the topic where the platform receives it.
            types: the known message types.
            until_s: latest time to use it, by the platform's clock; 0 for unknown.
            boot: of the command interface server that it is for; 0 for unknown.
            utc_s: now.

        Raises:
            Refused: the token that has the key does not sign.
        """
        data = types.encode(envelope)
        signature = self._key.sign(_statement(envelope.topic, data, until_s, boot, utc_s), ec.ECDSA(hashes.SHA256()))
        signed = SignedMessage(
            data=data, certificate=self._certificate, signature=signature, until_s=until_s, boot=boot, utc_s=utc_s
        )
        return msgspec.structs.replace(envelope, payload=signed, type=type_name(SignedMessage))


class RequestVerifier:
    """Verifies members' messages.

    Args:
        authority: certificate of the network's authority.
        accepted: the common names of the certificates that count, by member.
    """

    def __init__(self, authority: x509.Certificate, accepted: Mapping[str, str]) -> None:
        self._authority, self._accepted = authority, dict(accepted)
        self._certificates: dict[bytes, x509.Certificate] = {}

    def open(self, envelope: Envelope[SignedMessage], member: str, types: TypeRegistry, utc_s: float) -> Envelope[Any]:
        """The message in a signed one.

        Args:
            envelope: as it was received.
            member: who has to have signed it.
            types: the known message types.
            utc_s: now, for the certificate's dates.

        Raises:
            Refused: it is not signed by that member, or for another topic.
            WireError: what was signed is no message.
        """
        signed = envelope.payload
        certificate = self._certificate(signed.certificate)
        if name_of(certificate) != self._accepted.get(member):
            raise Refused(f"it is signed by {name_of(certificate) or 'a nameless certificate'}, which is not accepted")
        if (
            not certificate.not_valid_before_utc
            <= datetime.fromtimestamp(utc_s, UTC)
            <= certificate.not_valid_after_utc
        ):
            raise Refused(f"the certificate of {member} is not valid today; renew it, or set the clock")
        key = public_key(certificate)
        statement = _statement(envelope.topic, signed.data, signed.until_s, signed.boot, signed.utc_s)
        try:
            key.verify(signed.signature, statement, ec.ECDSA(hashes.SHA256()))
        except InvalidSignature:
            raise Refused("its signature is wrong: it was changed on the way, or is for another vehicle") from None
        found = types.decode(signed.data)
        if found.topic != envelope.topic:
            raise Refused(f"it says that it is of {found.topic}")
        return found

    def _certificate(self, data: bytes) -> x509.Certificate:
        """A certificate of the network's authority."""
        known = self._certificates.get(data)
        if known is not None:
            return known
        try:
            certificate = x509.load_der_x509_certificate(data)
            certificate.verify_directly_issued_by(self._authority)
            is_usable = isinstance(certificate.public_key(), ec.EllipticCurvePublicKey)
        except (ValueError, TypeError, InvalidSignature):
            is_usable = False
        if not is_usable:
            raise Refused("its certificate is not of this network's authority")
        if len(self._certificates) >= MOST_CERTIFICATES:
            self._certificates.clear()
        self._certificates[data] = certificate
        return certificate


def _statement(topic: str, data: bytes, until_s: float, boot: int, utc_s: float) -> bytes:
    return msgspec.msgpack.encode((PURPOSE, topic, data, until_s, boot, utc_s))
