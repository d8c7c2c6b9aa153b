"""Routes of topics over the link: direction, reliability and urgency."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import msgspec

from gloc3.exchange.tunnel.layout import Lane, TunnelRole
from gloc3.messages.command_interface import CiReply, CiRequest, Emergency, LoadMission, ReadMission, Steer, Verb
from gloc3.messages.summaries import ComponentTable, ContactSummary
from gloc3.messages.teleoperation import VelocityDemand
from gloc3.messages.topics import TopicRow
from gloc3.messages.watch import LARGE, WATCH, Sample


class Route(msgspec.Struct, frozen=True):
    """How a topic crosses the link."""

    sender: TunnelRole
    """The end that sends it; messages from the other end on this topic are not accepted."""
    is_reliable: bool
    every: int = 1
    """Every n-th message is sent."""
    is_view: bool = False
    """A sample for viewers: it is sent after everything else."""


RELIABLE: Final[Mapping[str, Route]] = {
    "ci/request": Route(TunnelRole.STATION, is_reliable=True),
    "ci/reply": Route(TunnelRole.PLATFORM, is_reliable=True),
    "contact": Route(TunnelRole.PLATFORM, is_reliable=True),
    "ci/event": Route(TunnelRole.PLATFORM, is_reliable=True),
    "ci/table": Route(TunnelRole.PLATFORM, is_reliable=True),
    "ci/trouble": Route(TunnelRole.PLATFORM, is_reliable=True),
    "ci/host_names": Route(TunnelRole.PLATFORM, is_reliable=True),
}
"""The topics that may not lose a message, below the platform's name."""

DEMAND: Final = Route(TunnelRole.STATION, is_reliable=False)
"""The newest counts, and none is sent again."""
SAMPLE: Final = Route(TunnelRole.PLATFORM, is_reliable=False, is_view=True)
LARGE_SAMPLE: Final = Route(TunnelRole.PLATFORM, is_reliable=True, is_view=True)

EMERGENCY_PATIENCE_S: Final = 5.0
"""An emergency that has not arrived by then is not carried out behind the operator's back."""
REQUEST_TIMEOUT_S: Final = 15.0
UPLOAD_TIMEOUT_S: Final = 60.0
ANSWER_TIMEOUT_S: Final = 120.0
CONTACT_TIMEOUT_S: Final = 10.0
"""Timeout of messages that matter only at the start of a contact: the next contact brings newer ones."""
VIEW_TIMEOUT_S: Final = 5.0
"""Time without progress after which a large sample is replaced by a newer one, s."""
LONG_TEXT: Final = 400


def route(name: str, row: TopicRow | None) -> Route | None:
    """How the topic `PLATFORM/name` crosses the link; None where it does not.

    Args:
        name: the topic below the platform's name.
        row: its row of the topic table.
    """
    if row is None:
        return None
    if row.downlink_every > 0:
        return Route(TunnelRole.PLATFORM, is_reliable=False, every=row.downlink_every)
    if name.startswith(WATCH):
        return LARGE_SAMPLE if name.startswith(LARGE) else SAMPLE
    return DEMAND if row.message is VelocityDemand else RELIABLE.get(name)


class Urgency(msgspec.Struct, frozen=True):
    """How a reliable message is sent."""

    lane: Lane
    timeout_s: float
    is_fence: bool = False


def urgency(message: Any, *, has_upload: bool, is_fenced: bool) -> Urgency:
    """The lane for a message, and how long it is worth sending.

    Emergencies overtake everything. Other requests overtake an upload, but not those which mean the uploaded mission
    (start, clear, read back), nor requests that wait behind one of these.

    Args:
        message: the payload.
        has_upload: the bulk lane to this peer is not empty.
        is_fenced: a request waits there for the upload.
    """
    if isinstance(message, CiRequest):
        body = message.body
        if isinstance(body, Emergency):
            return Urgency(Lane.URGENT, EMERGENCY_PATIENCE_S)
        if isinstance(body, LoadMission):
            return Urgency(Lane.BULK, UPLOAD_TIMEOUT_S)
        if is_fenced or (has_upload and _means_upload(body)):
            return Urgency(Lane.BULK, UPLOAD_TIMEOUT_S, is_fence=True)
        return Urgency(Lane.ORDINARY, REQUEST_TIMEOUT_S)
    if isinstance(message, ContactSummary):
        return Urgency(Lane.URGENT, CONTACT_TIMEOUT_S)
    if isinstance(message, Sample):
        return Urgency(Lane.VIEW, VIEW_TIMEOUT_S)
    is_long = isinstance(message, ComponentTable) or (
        isinstance(message, CiReply) and (len(message.text) > LONG_TEXT or "reports" in message.result)
    )
    return Urgency(Lane.BULK if is_long else Lane.ORDINARY, ANSWER_TIMEOUT_S)


def _means_upload(body: object) -> bool:
    return isinstance(body, ReadMission) or (isinstance(body, Steer) and body.verb in (Verb.START, Verb.CLEAR))
