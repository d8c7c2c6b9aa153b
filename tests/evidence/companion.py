"""Other people's tools at the autopilot and at the onboard computer, and what the onboard computer serves them."""

import asyncio
import gc
import os
import subprocess
import tracemalloc
from importlib.metadata import version
from random import Random
from typing import Any

from tests.evidence.page import Bar, Figure, Progress
from tests.evidence.suites import suite

TOOLS = (
    *(f"tests/onboard/test_{name}_through_the_onboard_process.py" for name in ("mavsdk", "mavproxy", "qgc")),
    "tests/onboard/companion/test_stations_on_all_kinds_of_links.py",
)
SERVICES = (
    "tests/flight/test_stations_of_others.py",
    "tests/flight/test_parameters_and_files_of_the_companion.py",
    *(f"tests/common/mavlink/test_{name}.py" for name in ("commands", "parameters", "mission_protocol", "ftp")),
    "tests/common/mavlink/test_upstream_definitions.py",
)
MOST_UNKNOWN = 5000
ROUNDS = 4
GROWTH_KB = 64.0


def tools(progress: Progress) -> list[Figure]:
    """Bar 3."""
    python = os.environ.get("MAVPROXY_PYTHON", "")
    requested = "import importlib.metadata as m; print(m.version('MAVProxy'))"
    found = (
        subprocess.run([python, "-c", requested], capture_output=True, text=True, check=True).stdout if python else ""
    )
    return [
        Figure("MAVSDK", version("mavsdk")),
        Figure("MAVProxy", found.strip() or "not here: MAVPROXY_PYTHON names no Python"),
        *suite("other-tools", list(TOOLS))(progress),
    ]


def growth() -> dict[str, float]:
    """What strangers leave behind: kilobytes after each round in which each of them asks for everything once."""
    from gloc3.clock import Clock, run_virtual
    from gloc3.component.context import HostContext
    from gloc3.exchange import LocalExchange, Publisher
    from gloc3.mavlink.codec import Encoder, Parser, message
    from gloc3.mavlink.message import Address
    from gloc3.mavlink.services.files.ftp import Operation, Payload
    from gloc3.messages.summaries import ControlState
    from gloc3.messages.topics import TopicTable
    from gloc3.network.rights import Rights
    from gloc3.platform.reader import load_platform
    from gloc3_onboard.companion.companion import Companion
    from gloc3_onboard.companion.files import MemoryFiles

    opened = Payload(operation=Operation.OPEN_FILE_READ_ONLY, size=5, data=b"/file").encode()
    requested: tuple[tuple[str, dict[str, Any]], ...] = (
        ("COMMAND_LONG", {"command": 300}),
        ("COMMAND_LONG", {"command": 32100, "param1": 1.0}),
        ("COMMAND_CANCEL", {"command": 300}),
        ("MISSION_COUNT", {"count": 3}),
        ("MISSION_REQUEST_LIST", {}),
        ("MISSION_CLEAR_ALL", {"mission_type": 255}),
        ("PARAM_SET", {"param_id": "HEIGHT_MAX_M", "param_value": 0x41200000, "param_type": 9}),
        ("PARAM_REQUEST_LIST", {}),
        ("FILE_TRANSFER_PROTOCOL", {"payload": opened}),
    )

    async def work() -> dict[str, float]:
        loop = asyncio.get_running_loop()
        own = Address(1, 191)
        exchange = LocalExchange()
        companion = Companion(
            own,
            load_platform("pelican"),
            HostContext("pelican", exchange, Clock(loop), loop, TopicTable(), Random(1)),
            Rights("pelican"),
        )
        holder = Publisher(exchange, "pelican", "command_server", 1)
        holder.publish("pelican/ci/control", ControlState(holder="255"), 0.0)
        companion.share(MemoryFiles({"file": bytes(1000)}))
        sent = [0]

        def count(_message: Any, _component: int) -> None:
            sent[0] += 1

        receive, parser = companion.attach(count), Parser(is_datagram=True)
        wanted = [message(name, target_system=1, target_component=191, **fields) for name, fields in requested]
        tracemalloc.start()
        sizes = []
        for _ in range(ROUNDS):
            for number in range(MOST_UNKNOWN):
                encoder = Encoder(number % 250 + 2, number // 250 + 1)
                receive([frame for one in wanted for frame in parser.receive(encoder.encode(one))])
                if number % 100 == 0:
                    await asyncio.sleep(0.05)
            await asyncio.sleep(70.0)
            gc.collect()
            sizes.append(tracemalloc.get_traced_memory()[0] / 1e3)
        tracemalloc.stop()
        companion.close()
        return {
            "grown_kb": sizes[-1] - sizes[1],
            "answers": float(sent[0]),
            "reasons": float(companion.reasons.reported),
        }

    return run_virtual(work())


def services(progress: Progress) -> list[Figure]:
    """Bars 6 and 7, as far as they are the onboard computer's services."""
    result = progress.part("growth", growth)
    requests = MOST_UNKNOWN * ROUNDS * 9
    return [
        Figure("requests of strangers", f"{requests:,} of {MOST_UNKNOWN:,} addresses"),
        Figure("commands, plans and values refused, as counted", f"{result['reasons']:,.0f}"),
        Figure(
            f"what rounds 3 to {ROUNDS} leave in memory, kB",
            f"{result['grown_kb']:.1f}",
            f"≤ {GROWTH_KB:g}",
            result["grown_kb"] <= GROWTH_KB,
        ),
        *suite("companion-services", list(SERVICES))(progress),
    ]


BARS = (
    Bar(
        "other-tools",
        "MAVSDK, MAVProxy and the message sequences of QGroundControl and dronekit work through the router",
        "Unmodified MAVSDK 4.1 and MAVProxy reach the autopilot and the onboard computer through `gloc3 onboard`, and "
        "so do the messages that QGroundControl sends, according to its public sources, when it connects and uploads "
        "a plan: links come up, parameters are fetched, missions are uploaded and flown, and modes change. Stations "
        "on UDP, TCP and a serial line do the same at once, while the one on TCP flies as dronekit does. "
        "`MAVPROXY_PYTHON` names the Python that has MAVProxy.",
        tools,
    ),
    Bar(
        "companion-services",
        "Other software uses the onboard computer by MAVLink's own protocols",
        "The onboard computer (component 191) serves commands, missions, fences, parameters, files, metadata and "
        "control by MAVLink's protocols. A refusal carries the right result and a readable reason. Thousands of "
        "unknown senders change nothing and leave nothing behind.",
        services,
    ),
)
