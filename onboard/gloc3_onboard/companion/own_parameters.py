"""The parameters of the onboard computer itself, beside those of its components."""

from collections.abc import Callable

from gloc3.messages.envelope import Severity
from gloc3_onboard.companion.companion import OwnParameter
from gloc3_onboard.companion.parameter_table import ParameterRow


def own_parameters(tell: Callable[[Severity], None], allow: Callable[[bool], None]) -> list[OwnParameter]:
    """How severe an event must be to be told as STATUSTEXT, and whether missions can be written over MAVLink FTP.

    Args:
        tell: takes the least severity.
        allow: takes whether files may be written.
    """
    severity = ParameterRow(
        name="TEXT_SEVERITY",
        component="",
        setting="text_severity",
        value=float(Severity.WARNING),
        low=0.0,
        high=float(Severity.DEBUG),
        is_whole=True,
        text="Events of components that are at least so severe are told as STATUSTEXT: 3 error, 4 warning, 6 information.",
    )
    writing = ParameterRow(
        name="FTP_WRITE",
        component="",
        setting="ftp_write",
        value=1.0,
        low=0.0,
        high=1.0,
        is_whole=True,
        text="Whether files of missions can be written over MAVLink FTP.",
    )
    return [
        OwnParameter(severity, lambda value: tell(Severity(int(value)))),
        OwnParameter(writing, lambda value: allow(value == 1.0)),
    ]
