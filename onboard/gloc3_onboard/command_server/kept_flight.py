"""What a former life of the command interface server was about when it ended."""

from gloc3.messages.vehicle import FlightMode
from gloc3.mission.executing.snapshot import Snapshot
from gloc3.mission.model.states import ActionState
from gloc3_onboard.command_server.facts import VehicleFacts
from gloc3_onboard.command_server.handover import OURS


def was_under_way(kept: Snapshot | None) -> bool:
    """Whether a mission, a single command or a policy had begun and not ended."""
    return kept is not None and (
        kept.policy is not None
        or any(program.own.state in (ActionState.RUNNING, ActionState.PAUSED) for program in kept.programs)
    )


def flies_for_us(facts: VehicleFacts, kept: Snapshot) -> bool:
    """Whether the vehicle does what was begun then, and the driver takes it for a pilot's."""
    state = facts.autopilot
    modes = (*OURS, FlightMode.MISSION) if _flew_a_plan(kept) else OURS
    is_ours = state is not None and state.is_armed and state.mode in modes
    is_taken = facts.driver is None or facts.driver.has_pilot_control
    return was_under_way(kept) and is_ours and is_taken and not kept.has_pilot


def _flew_a_plan(kept: Snapshot) -> bool:
    """Whether the autopilot had been given a plan to fly by itself."""
    items = (item for program in kept.programs for item in program.items.values())
    return any(item.is_planned and item.state is ActionState.RUNNING for item in items)
