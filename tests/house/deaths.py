"""`docs/when-it-dies.md`: what happens if a component dies, from the static proof of shipped platforms and missions."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

from tests.house.table import table

from gloc3_sitl.proof.case import FlightCase
from gloc3_sitl.proof.static_flights import prove_case
from gloc3_sitl.proof.static_proof import StaticProof

PAGE: Final = Path(__file__).parents[2] / "docs" / "when-it-dies.md"
FLIGHTS: Final = (("pelican", "inspection"), ("auv", "survey"), ("rover", "survey"), ("plane", "mapping"))
HEAD: Final = """\
# What happens when something dies

A component that turns faulty, hangs or leaves is one thing; a process, a computer or a cable takes many components with
it. This page says what follows, and where it is shown.

## Processes, computers and links

| what dies | what happens | shown by |
| --- | --- | --- |
| the onboard process | Setpoints end, and the autopilot holds by its own time-out. The service manager starts the process again, and the mission goes on by `on_restart` (hold). Progress and plan are on disk before an action is reported started. | [kills](evidence/kills.md), [service](evidence/service.md) |
| the command interface server, for good | The running action ends in a hold; then the process itself commands the autopilot to land. | `tests/flight/test_command_server_fails.py` |
| the disk | The flight goes on; an alert says that logging or the state on disk has stopped. | `tests/flight/test_command_server_fails.py`, `tests/flight/test_a_slow_disk.py` |
| a second computer of the vehicle | Its components count as lost, and `on_loss` of the host and their own policies apply; they come back with it. | [hosts](evidence/hosts.md) |
| the cable to the autopilot | The autopilot holds or lands by its own failsafe. The mission goes on when it is back in time. | [link-loss](evidence/link-loss.md), `tests/flight/test_autopilot_in_trouble.py` |
| the station, or its link | Nothing from the holder of control for `link_loss_after_s` (5 s), or from any station if nobody holds control: the mission's `on_link_loss`. Another station may request control. | [link-loss](evidence/link-loss.md), `tests/flight/test_policies_on_link_loss.py` |
| satellites, a camera, the laser | The position rests on the other sources. Where none is left: a hold while it may come back, then `on_pose_lost`. | [ablation](evidence/ablation.md), `tests/flight/test_policies_on_battery_and_pose.py` |
| another vehicle of the mission | `on_platform_loss`; its tasks can be assigned to others. | [fleet](evidence/fleet.md) |
| the autopilot | The vehicle falls or drifts: nothing onboard flies it. | [safety](safety.md) |

## Components

The tables below are made by the static proof from the platform file and the mission alone, for every component and every
action; `make docs` writes them. `gloc3 prove MISSION --platform FILE --static` does the same for yours and reports a
component without an answer as an error; `--fly` flies the answers in simulation ([proof](proof.md)). "Brought up again"
means that the supervision initializes and starts it again, with a pause that doubles.
"""


def page() -> str:
    """The whole page."""
    lines = [HEAD]
    for platform, mission in FLIGHTS:
        proof = prove_case(FlightCase(mission=mission, platform=platform, autopilot="", seed=0, world=""))
        lines += [
            f"### `{platform}`, mission `{mission}`\n",
            f"`gloc3 prove {mission} --platform {platform} --static`\n",
        ]
        lines += table(("what dies", "during", "what happens"), answers(proof))
    return "\n".join(lines).rstrip() + "\n"


def answers(proof: StaticProof) -> Iterator[tuple[str, str, str]]:
    """Rows: components that share phases and answer, the phases, the answer."""
    phases: dict[tuple[str, str], list[str]] = {}
    for cell in proof.cells:
        text = cell.answer.replace(f"on_fault of {cell.component}:", "its `on_fault`:")
        text += f"; no answer: {cell.problem}" if cell.problem else ""
        phases.setdefault((cell.component, text), []).append(cell.phase)
    count = len({cell.phase for cell in proof.cells})
    shared: dict[tuple[str, str], list[str]] = {}
    for (component, text), during in phases.items():
        when = "all actions" if len(during) == count else ", ".join(f"`{one}`" for one in during)
        shared.setdefault((when, text), []).append(component)
    for (when, text), components in shared.items():
        yield ", ".join(f"`{one}`" for one in components), when, text
