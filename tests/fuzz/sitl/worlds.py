"""Targets of the simulation: worlds, faults, replay files, and what a firmware sends to the physics."""

from math import inf

from tests.fuzz.target import as_file, fuzz_target, refuses

from gloc3_sitl.faults.faults import read_fault
from gloc3_sitl.firmware.json_wire import read_servos
from gloc3_sitl.proof.case import read_case
from gloc3_sitl.world import World


@fuzz_target("gloc3_sitl.world", "gloc3.documents")
def world_file(data: bytes) -> None:
    """A world file is a world whose ground has a height everywhere, or is refused with findings and places."""

    def whole() -> None:
        world = World.load(str(as_file(data, "world.yaml")))
        assert world.height_at(0.0, 0.0) < inf

    refuses(whole)


@fuzz_target("gloc3_sitl.faults")
def fault_text(data: bytes) -> None:
    """Any text is a fault that begins at a time, or is refused with its form."""
    refuses(lambda: read_fault(data.decode("utf-8", "replace")))


@fuzz_target("gloc3_sitl.proof.case")
def replay_file(data: bytes) -> None:
    """A replay file, or a line of found cases, is a flight that can be written again, or is refused."""
    path = as_file(data, "replay.json")

    def whole() -> None:
        case = read_case(path)
        case.command()
        assert read_case(as_file(case.line().encode(), "again.json")) == case

    refuses(whole)


@fuzz_target("gloc3_sitl.firmware.json_wire")
def servo_packet(data: bytes) -> None:
    """A datagram of a firmware is a packet of 16 or 32 outputs, or is none."""
    found = read_servos(data)
    assert found is None or len(found.pwm_us) in (16, 32)
