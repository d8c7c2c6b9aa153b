"""Targets of the station's services: files of parameters, their descriptions, plans that a vehicle has."""

import lzma

from tests.fuzz.common.mavlink import messages_of
from tests.fuzz.target import fuzz_target, refuses

from gloc3.documents.characters import first_steering
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.plan import PlanItem
from gloc3.mission.formats.plan import read_plan, write_plan
from gloc3_groundstation.services.descriptions.component_metadata import MetadataFile, read_general
from gloc3_groundstation.services.descriptions.parameter_info import info_of, read_infos
from gloc3_groundstation.services.parameter_files import read_parameter_file
from gloc3_groundstation.services.plan_items import PlanParts, from_wire, to_wire
from gloc3_groundstation.services.snapshot import Firmware


@fuzz_target("gloc3_groundstation.services.parameter_files")
def parameter_file(data: bytes) -> None:
    """Any bytes are parameters of finite values, or are refused with findings and places."""

    def whole() -> None:
        for one in read_parameter_file(data, "f").parameters:
            assert one.is_same(one.value)

    refuses(whole)


@fuzz_target("gloc3_groundstation.services.descriptions.parameter_info", "xml")
def parameter_description(data: bytes) -> None:
    """A firmware's description of its parameters, JSON or XML, packed or not, is used as far as it goes, or refused."""

    def whole(given: bytes) -> None:
        infos = read_infos(given, "f")
        for name, info in infos.items():
            assert info_of(infos, name) is not None
            assert not any(map(first_steering, (name, info.title, info.description, info.unit, info.group)))

    refuses(lambda: whole(data))
    refuses(lambda: whole(lzma.compress(data, preset=0)))


@fuzz_target("gloc3_groundstation.services.descriptions.component_metadata")
def general_metadata(data: bytes) -> None:
    """A vehicle's general file of metadata names a file of its own, or is refused."""
    general = MetadataFile(owner=Address(1, 1), path="general.json")
    refuses(lambda: read_general(data, general))


@fuzz_target("gloc3_groundstation.services.plan_items", "gloc3.mission.formats")
def plan_of_a_vehicle(data: bytes) -> None:
    """Mission, fence and rally points of a vehicle are a plan that can be saved and opened again, or are refused."""
    parts: dict[int, list[PlanItem]] = {0: [], 1: [], 2: []}
    for received, payload in messages_of(data, ("MISSION_ITEM_INT",)):
        item = PlanItem(
            command=received.command,
            frame=received.frame,
            param1=received.param1,
            param2=received.param2,
            param3=received.param3,
            param4=received.param4,
            x=received.x,
            y=received.y,
            z=received.z,
        )
        parts[len(payload) % 3].append(item)
    for firmware in Firmware:

        def whole(firmware: Firmware = firmware) -> None:
            plan = from_wire(PlanParts(mission=tuple(parts[0]), fence=tuple(parts[1]), rally=tuple(parts[2])), firmware)
            read_plan(write_plan(plan), "f")
            to_wire(plan, firmware)

        refuses(whole)
