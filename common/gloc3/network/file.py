"""The network file of one member: its identity, its endpoints, and the members and roles that it accepts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any, Final, NamedTuple

import msgspec
from msgspec.structs import replace

from gloc3.documents.document import Document, load_bytes, parse
from gloc3.documents.schema import check
from gloc3.errors import Finding, InputError, Refused, nearest
from gloc3.exchange.zenoh_session import QUIC, ZenohEndpoints
from gloc3.network.access import Accepted, MemberRole, access_control, size_limits
from gloc3.network.authority import SIGNING, expiry, public_key, read_certificate, read_key
from gloc3.network.authority import findings as certificate_findings
from gloc3.network.revocations import REVOCATIONS, RevocationList, read_list, verify_list
from gloc3.network.rights import ListValidity
from gloc3.network.rights_file import RightsFile, read_rights
from gloc3.network.security_token import TOKEN, read_token_key
from gloc3.network.signatures import RequestSigner, RequestVerifier

NAME: Final = re.compile(r"[a-z0-9][a-z0-9_-]{0,30}")
# QUIC before an address: encrypted over UDP, for links that lose packets; without it TLS over TCP.
ADDRESS: Final = re.compile(rf"(?:{QUIC})?(\[[0-9a-fA-F:.]+\]|[^\s:/\[\]]+):([0-9]{{1,5}})")
RESERVED: Final = ("members", "regions", "stations")
"""First levels of keys that are no platform's."""
MOST_PORT: Final = 65535


class Unconfirmed(StrEnum):
    """What stations may do with a platform whose list of revoked members has ended."""

    SAFETY = "safety"
    """Look, hold control, pause and abort, hold, return and land."""
    ALL = "all"
    """What their roles permit; the end is only reported."""


class NetworkFile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of `network.yaml`; paths are relative to it."""

    network: str
    member: str
    certificate: str = "certificate.pem"
    key: str = "key.pem"
    authority: str = "authority.pem"
    listen: list[str] = []
    """`HOST:PORT` or `quic/HOST:PORT`, where others connect to this member."""
    connect: list[str] = []
    """Addresses, of the same form, of the members that this one connects to."""
    uplinks: list[str] = []
    """The members at those addresses: all others are below this one, and may connect to it."""
    peers: list[str] | None = None
    """Of those below, the ones that connect to others as well; None in files of before there was this list: any."""
    region: list[str] = []
    """Of a router: the platforms that connect to it, which it sums up."""
    watches: list[str] = []
    """Of a station: the platforms of which it gets all details; of others it gets what routers sum up. Empty for all."""
    revocations: str = ""
    """The list of revoked members; empty for files of before there was one."""
    unconfirmed: Unconfirmed = Unconfirmed.SAFETY
    """What stations may do with the platform when that list has ended."""
    rights: str = ""
    """The file with the members' rights; empty where there is none, and every operator may do everything."""
    accepts: list[Accepted]
    """All members that this one has to do with, itself among them."""

    @property
    def own(self) -> Accepted:
        """This member."""
        return next(entry for entry in self.accepts if entry.member == self.member)

    @property
    def others(self) -> list[Accepted]:
        """The other members."""
        return [entry for entry in self.accepts if entry.member != self.member]

    @property
    def roles(self) -> Mapping[str, MemberRole]:
        """The role of each member."""
        return {entry.member: entry.role for entry in self.accepts}


class Membership(NamedTuple):
    """A network file that was read and is valid."""

    path: Path
    file: NetworkFile
    rights: RightsFile | None = None
    """Of the members for this platform; None without a file, and for stations, which the platforms tell."""
    revocations: RevocationList | None = None
    """The newest list; None for none."""

    def node(self, *sockets: str) -> ZenohEndpoints:
        """This member as a Zenoh node.

        Args:
            sockets: endpoints for child processes, in addition to those in the file.
        """
        file = self.file
        below = [other.member for other in file.others if other.member not in file.uplinks]
        return ZenohEndpoints(
            name=file.member,
            listen=(*map(_endpoint, file.listen), *sockets),
            connect=tuple(map(_endpoint, file.connect)),
            peers=tuple(name for name in below if file.peers is None or name in file.peers),
            client_of=tuple(file.uplinks) if len(file.uplinks) == 1 else (),
        )

    def expiry(self, now: datetime) -> str:
        """A warning of a certificate that expires soon; empty where it does not."""
        return expiry(self.path.parent / self.file.certificate, now)

    @property
    def commanding(self) -> list[str]:
        """The members that may send commands at all."""
        return [name for name, role in self.file.roles.items() if role is MemberRole.OPERATOR]

    def signer(self) -> RequestSigner:
        """Signs this member's requests; waits for the PIN where its key is in a token.

        Raises:
            Refused: the token cannot be used, or has another key.
            InputError: a file is missing.
        """
        file, folder = self.file, self.path.parent
        if not file.own.signs:
            return RequestSigner(read_key(folder / file.key), read_certificate(folder / file.certificate))
        key, certificate = read_token_key(folder), read_certificate(folder / SIGNING)
        if key.public_key() != public_key(certificate):
            raise Refused(f"the key that {folder / TOKEN} names is not that of {SIGNING}: is it the right token?")
        return RequestSigner(key, certificate)

    def watching(self, platforms: Sequence[str]) -> Membership:
        """The same station with all details of these platforms."""
        return self._replace(file=replace(self.file, watches=list(platforms)))

    @property
    def list_path(self) -> Path:
        """Where the newest list of revoked members is kept."""
        return self.path.parent / (self.file.revocations or REVOCATIONS)

    @property
    def validity(self) -> ListValidity | None:
        """Until when the list of revoked members counts as up to date; None where its end has no consequence."""
        if self.revocations is None or self.file.unconfirmed is Unconfirmed.ALL:
            return None
        return ListValidity(self.revocations.number, self.revocations.end_s)

    def verified(self, data: bytes) -> RevocationList:
        """A list of revoked members, DER.

        Raises:
            Refused: the network's authority has not signed it.
        """
        return verify_list(data, read_certificate(self.path.parent / self.file.authority))

    def under(self, revocations: RevocationList | None) -> Membership:
        """The same without the members that a list revokes; itself stays, and has to be told."""
        if revocations is None:
            return self
        own, revoked = self.file.member, revocations.certificates
        accepts = [one for one in self.file.accepts if one.member == own or one.certificate not in revoked]
        return self._replace(file=replace(self.file, accepts=accepts), revocations=revocations)

    def verifier(self) -> RequestVerifier:
        """Verifies the requests of the members that are accepted."""
        accepted = {entry.member: entry.signing_name for entry in self.file.accepts}
        return RequestVerifier(read_certificate(self.path.parent / self.file.authority), accepted)

    def settings(self) -> dict[str, Any]:
        """Zenoh's settings for encryption and access: mutual TLS by the network's own authority, rules by role."""
        file, folder = self.file, self.path.parent
        certificate, key = str(folder / file.certificate), str(folder / file.key)
        return {
            "transport/link/tls": {
                "root_ca_certificate": str(folder / file.authority),
                "enable_mtls": True,
                "listen_certificate": certificate,
                "listen_private_key": key,
                "connect_certificate": certificate,
                "connect_private_key": key,
                "verify_name_on_connect": False,  # addresses change; the rules go by the certificate's name
                "close_link_on_expiration": True,
            },
            "access_control": access_control(file.own, file.others),
            "low_pass_filter": size_limits(),
        }


def read_network(path: Path, now: datetime, newest: RevocationList | None = None) -> Membership:
    """Reads a network file and what belongs to it, and checks the certificate and the key.

    Args:
        path: the file.
        now: certificates have to be valid then.
        newest: the newest list of revoked members that is known besides the one in the folder.

    Raises:
        InputError: lists all errors.
    """
    document = parse(load_bytes(path), str(path))
    found: list[Finding] = []
    file = check(document.root, NetworkFile, str(path), found)
    if file is not None:
        found += _findings(document, file)
    if file is None or found:
        raise InputError(sorted(found))
    folder = path.parent
    missing = (("rights", "nobody's rights are known"), ("revocations", "nobody knows who is revoked"))
    for key, consequence in missing:
        if (name := getattr(file, key)) and not (folder / name).exists():
            message = f"{name} is not there, so {consequence}"
            raise InputError([document.finding((key,), message, "copy the whole folder from the network's")])
    found = certificate_findings(
        folder / file.certificate, folder / file.key, folder / file.authority, file.own.common_name, now
    )
    if file.own.signs:
        signing = folder / SIGNING
        found += certificate_findings(signing, None, folder / file.authority, file.own.signing_name, now)
    if found:
        raise InputError(found)
    rights = read_rights(folder / file.rights, file.roles).file if file.rights else None
    membership = Membership(path.absolute(), file, rights)
    if membership.list_path.exists():
        kept = read_list(membership.list_path, read_certificate(folder / file.authority))
        newest = max(filter(None, (newest, kept)), key=lambda one: one.number)
    if newest is not None and file.own.certificate in newest.certificates:
        message = f"{file.member} is revoked by {newest}"
        raise InputError([document.finding(("member",), message, "ask for a new certificate: gloc3 network request")])
    return membership.under(newest)


def _findings(document: Document, file: NetworkFile) -> list[Finding]:
    found = []
    names = [entry.member for entry in file.accepts]
    for index, entry in enumerate(file.accepts):
        problem = member_problem(entry.member, entry.role)
        if problem:
            found.append(document.finding(("accepts", index, "member"), problem))
        if entry.member in names[:index]:
            found.append(document.finding(("accepts", index, "member"), f"{entry.member} is already accepted"))
    if file.member not in names:
        hint = nearest(file.member, names)
        found.append(document.finding(("member",), f"{file.member!r} is not in its own list of accepted members", hint))
    for where in ("listen", "connect"):
        for index, address in enumerate(getattr(file, where)):
            problem = address_problem(address)
            if problem:
                found.append(
                    document.finding(
                        (where, index), problem, "write HOST:PORT, such as 192.168.1.10:7447, or quic/HOST:PORT"
                    )
                )
    for where, listed in (("uplinks", file.uplinks), ("peers", file.peers or [])):
        for index, name in enumerate(listed):
            if name not in names:
                message = f"{name!r} is not among the accepted members"
                found.append(document.finding((where, index), message, nearest(name, names)))
    if not file.listen and not file.connect:
        found.append(document.finding(("member",), "neither listens nor connects anywhere", "add listen or connect"))
    return found


def member_problem(member: str, role: MemberRole) -> str:
    """What is wrong with a member's name; empty where nothing is."""
    parts = member.split(".")
    if not all(NAME.fullmatch(part) for part in parts):
        return f"{member!r} is not a valid name: lower-case letters, digits, _ and -, at most 31 of them"
    if parts[0] in RESERVED:
        return f"{parts[0]!r} cannot be a name: keys of the network begin with it; choose another one"
    if role is MemberRole.PLATFORM and len(parts) != 2:
        return f"{member!r} is not a host of a platform: write PLATFORM.HOST, such as {parts[0]}.main"
    if role is not MemberRole.PLATFORM and len(parts) != 1:
        return f"{member!r} is not the name of a station or a router: write it without a dot"
    return ""


def host_of(address: str) -> str:
    """The name or number of the computer in an address."""
    return address.removeprefix(QUIC).rpartition(":")[0].strip("[]")


def _endpoint(address: str) -> str:
    """An address as Zenoh writes it."""
    return address if address.startswith(QUIC) else f"tls/{address}"


def address_problem(address: str) -> str:
    """What is wrong with an address; empty where nothing is."""
    match = ADDRESS.fullmatch(address)
    if match is None:
        return f"{address!r} is not an address"
    return "" if 0 < int(match[2]) <= MOST_PORT else f"{match[2]} is not a port: 1 to {MOST_PORT}"
