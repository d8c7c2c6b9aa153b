"""Target of what a station asks of a platform: any requests, one after another."""

from typing import Final

import msgspec
from tests.fuzz.target import fuzz_target, refuses
from tests.onboard.command_server.test_request_handler import Desk

from gloc3.errors import UNREADABLE
from gloc3.messages.command_interface import AnyBody, Control, ControlVerb, Outcome
from gloc3.platform.reader import load_platform

PLATFORM: Final = load_platform("pelican_rtk")


@fuzz_target("gloc3_onboard.command_server", "gloc3.mission.executing")
def station_requests(data: bytes) -> None:
    """Any requests of a station in control, a line each, are carried out or refused with a reason; nothing is raised."""
    desk = Desk(PLATFORM)
    desk.reported(Control(verb=ControlVerb.REQUEST))
    for line in data.split(b"\n"):

        def whole(line: bytes = line) -> None:
            reply = desk.request(msgspec.json.decode(line, type=AnyBody))
            if reply is not None:
                msgspec.msgpack.encode(reply)
                assert reply.reason or reply.outcome is not Outcome.REFUSED

        refuses(whole, *UNREADABLE)
        for request in desk.host.take(0.1):
            desk.host.carry_out(request)
        desk.handler.expire(0.1)
        desk.handler.components.messages.clear()
