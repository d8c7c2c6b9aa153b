"""The scenario of a mission transfer over a lossy link, cheap enough to run for a thousand seeds.

`transfer(seed, items, loss)` uploads a plan and reads it back, both ends ours, in virtual time.
"""

import random
import sys
from dataclasses import dataclass

from gloc3.mavlink.services.mission_client import MissionClient, Transfer
from gloc3.mavlink.services.mission_server import MissionServer
from gloc3.mavlink.services.plan import PlanItem, PlanResult, PlanType
from gloc3.mavlink.transport.memory import Conditions

from .pair import STATION, VEHICLE, Pair


@dataclass(frozen=True)
class TransferResult:
    """How an upload and the download behind it ended."""

    upload: PlanResult | None
    """None if it had not ended in the time that was given."""
    download: PlanResult | None
    is_equal: bool
    """Whether the vehicle holds, and gave back, exactly what was sent."""
    upload_s: float
    """Virtual seconds."""
    download_s: float
    frames: int
    """Frames that were sent both ways."""

    @property
    def is_good(self) -> bool:
        return self.upload is PlanResult.ACCEPTED and self.download is PlanResult.ACCEPTED and self.is_equal


def plan(seed: int, items: int) -> tuple[PlanItem, ...]:
    """A plan of random waypoints."""
    chance = random.Random(seed)
    return tuple(
        PlanItem(
            command=16,
            frame=3,
            is_current=number == 0,
            param1=float(chance.randrange(10)),
            x=chance.randrange(-900_000_000, 900_000_000),
            y=chance.randrange(-1_800_000_000, 1_800_000_000),
            z=chance.randrange(4000) / 8,
        )
        for number in range(items)
    )


def transfer(
    seed: int,
    items: int = 800,
    loss: float = 0.1,
    *,
    latency_s: float = 0.02,
    kind: PlanType = PlanType.MISSION,
    limit_s: float = 3600.0,
) -> TransferResult:
    """Uploads a plan and reads it back.

    Args:
        seed: of the plan and of the link.
        items: in the plan.
        loss: probability that a frame is lost, each way.
        latency_s: of a frame, each way; a quarter of it more by chance.
        kind: the type of plan.
        limit_s: virtual seconds after which each transfer counts as stuck.
    """
    pair = Pair(seed, Conditions(latency_s=latency_s, jitter_s=latency_s / 4, loss=loss))
    server, client = MissionServer(VEHICLE), MissionClient(STATION)
    pair.add([server], [client])
    sent = plan(seed, items)

    def run(wanted: Transfer) -> float:
        began_s = pair.now_s
        pair.run(limit_s, lambda: wanted.result is not None)
        return pair.now_s - began_s

    upload = client.upload(VEHICLE, sent, kind=kind, now_s=pair.now_s)
    upload_s = run(upload)
    download = client.download(VEHICLE, kind=kind, now_s=pair.now_s)
    download_s = run(download)
    return TransferResult(
        upload=upload.result,
        download=download.result,
        is_equal=server.plans[kind] == sent and download.items == sent,
        upload_s=upload_s,
        download_s=download_s,
        frames=pair.link.a.sent + pair.link.b.sent,
    )


if __name__ == "__main__":
    seeds = range(*(int(word) for word in sys.argv[1:])) if len(sys.argv) > 1 else range(10)
    results = [transfer(seed) for seed in seeds]
    uploads, downloads = sorted(r.upload_s for r in results), sorted(r.download_s for r in results)
    print(f"{len(results)} transfers, {sum(not r.is_good for r in results)} failures")
    for name, times_s in (("upload", uploads), ("download", downloads)):
        print(f"{name}: median {times_s[len(times_s) // 2]:.1f} s, worst {times_s[-1]:.1f} s")
