"""The answer to a station's request, addressed as the request was."""

from typing import Any

from gloc3.messages.command_interface import CiReply, CiRequest, Outcome


def answer(
    request: CiRequest,
    outcome: Outcome = Outcome.ACCEPTED,
    reason: str = "",
    *,
    text: str = "",
    result: dict[str, Any] | None = None,
) -> CiReply:
    """A reply to that request; accepted unless it says otherwise."""
    return CiReply(
        sender=request.sender,
        boot=request.boot,
        sequence=request.sequence,
        outcome=outcome,
        reason=reason,
        text=text,
        result=result or {},
    )
