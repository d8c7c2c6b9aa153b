"""`make bench`: what the parts cost on this machine, and against the commit that was measured last (`history`).

Costs are per cycle or per message; ratios compare machines.
"""

import sys
from collections.abc import Callable

from tests.benchmarks import (
    footprint,
    front_door,
    fusion,
    ground,
    history,
    laser,
    network,
    parts,
    router,
    stereo,
    terminal,
    turnaround,
    world,
)

BENCHES: dict[str, Callable[[], list[str]]] = {
    "parts": parts.run,
    "history": history.run,
    "turnaround": turnaround.run,
    "network": network.run,
    "front_door": front_door.run,
    "router": router.run,
    "footprint": footprint.run,
    "terminal": terminal.run,
    "ground": ground.run,
    "laser": laser.run,
    "stereo": stereo.run,
    "fusion": fusion.run,
    "world": world.run,
}


def main(names: list[str]) -> int:
    """Runs the benches of these names, or all."""
    unknown = [name for name in names if name not in BENCHES]
    if unknown:
        print(f"no bench {unknown[0]!r}; there are: {', '.join(BENCHES)}", file=sys.stderr)
        return 2
    for name in names or list(BENCHES):
        print(f"{name}:", flush=True)
        for line in BENCHES[name]():
            print(f"  {line}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
