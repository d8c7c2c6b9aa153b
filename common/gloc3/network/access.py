"""Permissions of each role: the rules that Zenoh enforces on every link, by the peer's certificate."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from typing import Any, Final, Literal, NamedTuple

import msgspec

from gloc3.messages.topics import ENVELOPE_BYTES, MESSAGE_BYTES


class MemberRole(StrEnum):
    """Role of a member."""

    PLATFORM = "platform"
    """A host of a platform: `PLATFORM.HOST`."""
    OPERATOR = "operator"
    """A station that may command."""
    OBSERVER = "observer"
    """A station that only reads."""
    ROUTER = "router"
    """A computer that forwards messages, and has none of its own."""


class Accepted(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A member that others accept."""

    member: str
    role: MemberRole
    certificate: str
    """The number of its one certificate that counts."""
    signs: str = ""
    """The number of the certificate with whose key it signs requests, where that is in a token; empty for the same one."""

    @property
    def common_name(self) -> str:
        """What its certificate calls it: another certificate of the same member is another name."""
        return common_name(self.member, self.certificate)

    @property
    def signing_name(self) -> str:
        """What the certificate calls it with whose key it signs requests."""
        return common_name(self.member, self.signs or self.certificate)

    @property
    def platform(self) -> str:
        """Of a platform's host, the platform's name."""
        return self.member.partition(".")[0]


Flow = Literal["ingress", "egress"]
Speech = Literal["say", "ask"]
MESSAGES: Final[dict[Speech, tuple[str, ...]]] = {
    "say": ("put", "delete", "reply", "declare_queryable", "liveliness_token"),
    "ask": ("declare_subscriber", "query", "declare_liveliness_subscriber", "liveliness_query"),
}
"""Zenoh's message types for publishing, and for subscribing and querying."""
READABLE: Final = (
    "ci/**",
    "contact",
    "log_chunk/**",
    "watch/**",
    "components/*/status",
    "components/*",
    "hosts/**",
    "latched/ci/**",
)
"""What stations may read of a platform, below its name: topics and tokens."""
SEEN_BY_PLATFORMS: Final = ("ci/summary", "ci/mission", "ci/control")
"""What one platform may read of another, on a link between them."""
REQUESTED: Final = ("ci/request/*", "ci/ask/*", "demand/*")
"""What stations say to a platform, below its name, each on a key of its own."""
STATIONS: Final = "stations/**"
REVOCATIONS_OF_ALL: Final = "members/**"
"""Where members say which list of revoked members they have. Its signature is the authority's: anyone may pass it on."""
EVERYTHING: Final = "**"
CHILDREN: Final = "children"


class AccessGrant(NamedTuple):
    """A key pattern that a member permits on its links to another."""

    flow: Flow
    """`ingress`: from the other; `egress`: to it."""
    speech: Speech
    keys: tuple[str, ...]


def _below(platform: str, names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(f"{platform}/{name}" for name in names)


REGIONS: Final = "regions/**"
"""Where routers say how the vehicles are that connect to them."""
FORWARDED: Final = (*_below("*", READABLE), *_below("*", REQUESTED), STATIONS, REVOCATIONS_OF_ALL, REGIONS)
"""What routers say to each other."""


def common_name(member: str, certificate: str) -> str:
    """The common name of a certificate."""
    return f"{member}/{certificate}"


def grants(own: Accepted, other: Accepted) -> list[AccessGrant]:
    """Messages that a member permits between itself and another."""
    if other.role is MemberRole.ROUTER:
        return _links(from_other=_below_router(own), from_own=_above_router(own))
    if own.role is MemberRole.ROUTER:
        return _links(from_other=_above_router(other), from_own=_below_router(other))
    if own.role is MemberRole.PLATFORM and other.role is MemberRole.PLATFORM:
        return _peers(own, other) if own.platform != other.platform else _all((EVERYTHING,))
    if own.role is MemberRole.PLATFORM:
        return [
            AccessGrant("ingress", "say", spoken(other, own.platform)),
            AccessGrant("ingress", "ask", (*_below("*", READABLE), REVOCATIONS_OF_ALL)),
            AccessGrant("egress", "say", (*_below(own.platform, READABLE), REVOCATIONS_OF_ALL)),
            AccessGrant("egress", "ask", (EVERYTHING,)),
        ]
    if other.role is MemberRole.PLATFORM:
        return [
            AccessGrant("ingress", "say", (f"{other.platform}/**", STATIONS, REVOCATIONS_OF_ALL)),
            AccessGrant("ingress", "ask", (EVERYTHING,)),
            AccessGrant("egress", "say", spoken(own, other.platform)),
            AccessGrant("egress", "ask", (EVERYTHING,)),
        ]
    return []


def _above_router(member: Accepted) -> tuple[str, ...]:
    """What a member says to a router: its own, and a router what it has been told."""
    if member.role is MemberRole.ROUTER:
        return FORWARDED
    if member.role is MemberRole.PLATFORM:
        return (*_below(member.platform, READABLE), REVOCATIONS_OF_ALL)
    return spoken(member, "*")


def _below_router(member: Accepted) -> tuple[str, ...]:
    """What a router says to a member: to a platform what stations say to it, to a station what platforms report.

    So that a router cannot pass for a part of the platform, it says to it nothing that this says itself.
    """
    match member.role:
        case MemberRole.ROUTER:
            return FORWARDED
        case MemberRole.PLATFORM:
            return (*_below(member.platform, REQUESTED), STATIONS, REVOCATIONS_OF_ALL)
        case _:
            return (*_below("*", READABLE), STATIONS, REVOCATIONS_OF_ALL, REGIONS)


def _links(*, from_other: tuple[str, ...], from_own: tuple[str, ...]) -> list[AccessGrant]:
    """On a link with a router."""
    return [
        AccessGrant("ingress", "say", from_other),
        AccessGrant("ingress", "ask", (EVERYTHING,)),
        AccessGrant("egress", "say", from_own),
        AccessGrant("egress", "ask", (EVERYTHING,)),
    ]


def spoken(station: Accepted, platform: str) -> tuple[str, ...]:
    """What a station may say to a platform."""
    own = f"{station.member}/**"
    keys = (f"{platform}/ci/ask/{station.member}", f"stations/{own}", f"members/{own}")
    if station.role is not MemberRole.OPERATOR:
        return keys
    return (f"{platform}/ci/request/{station.member}", f"{platform}/demand/{station.member}", *keys)


def access_control(own: Accepted, others: Sequence[Accepted]) -> dict[str, Any]:
    """Zenoh's `access_control`: members that are not listed send and receive nothing.

    Child processes, which reach this one over a socket that only its user may open, may do everything.
    """
    rules: list[dict[str, Any]] = []
    policies = []
    for other in others:
        names = []
        for grant in grants(own, other):
            names.append(f"{other.member} {grant.speech} {grant.flow}")
            rules.append(_rule(names[-1], grant))
        if names:
            policies.append({"rules": names, "subjects": [other.member]})
    children = [(f"{CHILDREN} {grant.speech} {grant.flow}", grant) for grant in _all((EVERYTHING,))]
    rules += [_rule(name, grant) for name, grant in children]
    policies.append({"rules": [name for name, _ in children], "subjects": [CHILDREN]})
    subjects: list[dict[str, Any]] = [
        {"id": other.member, "cert_common_names": [other.common_name]} for other in others if grants(own, other)
    ]
    subjects.append({"id": CHILDREN, "link_protocols": ["unixsock-stream"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def size_limits() -> list[dict[str, Any]]:
    """Zenoh's `low_pass_filter`: longer messages between platforms and stations are dropped before they are read."""
    keys = [
        *_below("*", ("ci/**", "contact", "demand/*", "components/**", "hosts/**")),
        "stations/**",
        "members/**",
        REGIONS,
    ]
    return [
        {
            "id": "messages",
            "flows": ["ingress"],
            "messages": ["put", "delete", "query", "reply"],
            "key_exprs": keys,
            "size_limit": MESSAGE_BYTES + ENVELOPE_BYTES,
        }
    ]


def _rule(name: str, grant: AccessGrant) -> dict[str, Any]:
    return {
        "id": name,
        "permission": "allow",
        "flows": [grant.flow],
        "messages": list(MESSAGES[grant.speech]),
        "key_exprs": list(grant.keys),
    }


def _all(keys: tuple[str, ...]) -> list[AccessGrant]:
    flows: tuple[Flow, ...] = ("ingress", "egress")
    return [AccessGrant(flow, speech, keys) for flow in flows for speech in MESSAGES]


def _peers(own: Accepted, other: Accepted) -> list[AccessGrant]:
    """Between hosts of two platforms."""
    return [
        AccessGrant("ingress", "say", (*_below(other.platform, SEEN_BY_PLATFORMS), REVOCATIONS_OF_ALL)),
        AccessGrant("ingress", "ask", (*_below("*", SEEN_BY_PLATFORMS), REVOCATIONS_OF_ALL)),
        AccessGrant("egress", "say", (*_below(own.platform, SEEN_BY_PLATFORMS), REVOCATIONS_OF_ALL)),
        AccessGrant("egress", "ask", (EVERYTHING,)),
    ]
