"""Ports and the bounded queues behind them."""

from collections import deque
from math import inf, nan

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gloc3.component.cycle import Mailbox
from gloc3.component.ports import Input, Keep, Output, Port, PortGroup, PortReport, inbox_of, ports_of
from gloc3.errors import Misuse
from gloc3.messages.envelope import Envelope, Message, Source
from gloc3.messages.vehicle import Pose


class Reading(Message, frozen=True):
    """A number from a device."""

    value: float


class Ports:
    """A class that declares ports."""

    newest = Input(Reading)
    every = Input(Reading, keep=Keep.ALL, depth=3)
    out = Output(Reading, frame="ned")


class MorePorts(Ports):
    """Adds one, and declares one anew."""

    out = Output(Reading, frame="local")
    extra = Output(Reading)


def envelope(value: float, t_s: float = 0.0) -> Envelope[Reading]:
    """A reading on its way."""
    return Envelope("p/t", Source("p", "c", 1), 0, t_s, "", "Reading#", Reading(value=value))


def test_a_class_declares_its_ports_and_inherits_those_of_its_bases() -> None:
    inputs, outputs = ports_of(MorePorts)
    assert list(inputs) == ["newest", "every"]
    assert list(outputs) == ["out", "extra"]
    assert outputs["out"].frame == "local"
    assert outputs["out"].name == "out"


def test_a_port_is_an_input_or_an_output() -> None:
    class Neither:
        odd = Port(Reading)

    with pytest.raises(Misuse, match=r"Neither\.odd is neither Input nor Output"):
        ports_of(Neither)


class Group(PortGroup):
    """Ports of one part."""

    first = Input(Reading)
    second = Output(Reading)


def test_ports_of_a_part_stand_in_a_group_under_their_own_names() -> None:
    class Whole(Ports):
        part = Group

    inputs, outputs = ports_of(Whole)
    assert list(inputs) == ["newest", "every", "first"]
    assert list(outputs) == ["out", "second"]
    assert Group.second.report(Reading(value=1.0)).port == "second"


def test_two_groups_do_not_declare_one_name() -> None:
    class Twice:
        part = Group
        first = Output(Reading)

    with pytest.raises(Misuse, match=r"Twice\.first: Twice has a port 'first' already"):
        ports_of(Twice)


def test_an_output_makes_reports() -> None:
    report = MorePorts.extra.report(Reading(value=1.0), t_s=2.0)
    assert report == PortReport("extra", Reading(value=1.0), 2.0)


def test_an_inbox_gives_what_is_new_and_the_last_of_each() -> None:
    mailbox = Mailbox(list(ports_of(Ports)[0].values()))
    for value in range(2):
        mailbox.put("newest", envelope(value, t_s=value))
        mailbox.put("every", envelope(value))
    first = mailbox.drain()
    assert [e.payload.value for e in first.new(Ports.newest)] == [1.0]
    assert [e.payload.value for e in first.new(Ports.every)] == [0.0, 1.0]
    second = mailbox.drain()
    assert (second.new(Ports.newest), second.new(Ports.every)) == ((), ())
    latest = second.latest(Ports.newest)
    assert latest is not None
    assert latest.payload.value == 1.0
    assert second.is_fresh(Ports.newest, 1.5, 0.5)
    assert not second.is_fresh(Ports.newest, 1.6, 0.5)


def test_a_pose_that_is_no_number_reaches_no_component_and_is_counted() -> None:
    class Follower(Ports):
        pose = Input(Pose)

    def posed(pose: Pose) -> Envelope[Pose]:
        return Envelope("p/pose", Source("p", "pose", 1), 0, 0.0, "", "Pose", pose)

    good = Pose(position_ned_m=(1.0, 2.0, 3.0), velocity_ned_m_s=(0.0, 0.0, 0.0), ned_from_frd=(1.0, 0.0, 0.0, 0.0))
    mailbox = Mailbox(list(ports_of(Follower)[0].values()))
    wrong = (
        {"position_ned_m": (1.0, nan, 3.0)},
        {"velocity_ned_m_s": (0.0, 0.0, inf)},
        {"ned_from_frd": (nan, 0.0, 0.0, 0.0)},
        {"position_std_m": (nan, 0.0, 0.0)},
        {"origin_geo": (nan, 8.0, 400.0)},
        {"quality": nan},
        # An autopilot is told the origin before the pose is valid.
        {"origin_geo": (47.0, nan, 400.0), "is_valid": False},
    )
    for changes in wrong:
        mailbox.put("pose", posed(msgspec.structs.replace(good, **changes)))
    assert mailbox.dropped == len(wrong)
    assert mailbox.drain().latest(Follower.pose) is None
    lost = msgspec.structs.replace(good, position_ned_m=(nan, nan, nan), is_valid=False, reason="lost")
    for pose in (good, lost):
        mailbox.put("pose", posed(pose))
        latest = mailbox.drain().latest(Follower.pose)
        assert latest is not None
        assert latest.payload is pose


def test_an_inbox_that_was_taken_does_not_change() -> None:
    mailbox = Mailbox(list(ports_of(Ports)[0].values()))
    mailbox.put("newest", envelope(1.0))
    inbox = mailbox.drain()
    again = mailbox.drain()
    mailbox.put("newest", envelope(2.0))
    mailbox.drain()
    mailbox.clear()
    for used in (inbox, again):
        latest = used.latest(Ports.newest)
        assert latest is not None
        assert latest.payload.value == 1.0
    assert mailbox.drain().latest(Ports.newest) is None


@settings(max_examples=80)
@given(st.lists(st.sampled_from(["newest", "every", "take", "clear"]), max_size=40))
def test_queues_are_bounded_and_what_is_dropped_is_counted(steps: list[str]) -> None:
    mailbox = Mailbox(list(ports_of(Ports)[0].values()))
    newest: deque[float] = deque(maxlen=1)
    every: list[float] = []
    dropped = 0
    for number, step in enumerate(steps):
        match step:
            case "newest":
                mailbox.put("newest", envelope(number))
                newest.append(number)
            case "every":
                mailbox.put("every", envelope(number))
                if len(every) < 3:
                    every.append(number)
                else:
                    dropped += 1
            case "take":
                inbox = mailbox.drain()
                assert [e.payload.value for e in inbox.new(Ports.newest)] == list(newest)
                assert [e.payload.value for e in inbox.new(Ports.every)] == every
                newest.clear()
                every.clear()
            case "clear":
                mailbox.clear()
                newest.clear()
                every.clear()
    assert mailbox.dropped == dropped


def test_an_inbox_for_tests_is_made_of_envelopes() -> None:
    inbox = inbox_of(newest=envelope(1.0), every=[envelope(2.0), envelope(3.0)])
    assert [e.payload.value for e in inbox.new(Ports.every)] == [2.0, 3.0]
    latest = inbox.latest(Ports.every)
    assert latest is not None
    assert latest.payload.value == 3.0
