"""Plans go up and down by the station's own mission client: with progress, cancelled on the vehicle, refused in words."""

import asyncio

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.plan import PlanResult, PlanType
from gloc3.mavlink.transport.memory import Conditions
from gloc3.mission.formats.items import ForeignPlan, MavItem, PlanEntry
from gloc3_groundstation.services.progress import JobProgress

from .scripted_vehicle import STATION, Scene, over

COUNT, ITEM, ACK = 44, 73, 47
"""MISSION_COUNT, MISSION_ITEM_INT, MISSION_ACK."""


def plan(size: int) -> ForeignPlan:
    items = (MavItem(command=16, frame=3, x=47.1 + n * 1e-5, y=8.5, z=10.0) for n in range(size))
    return ForeignPlan(entries=tuple(PlanEntry(items=(item,)) for item in items), raw={})


def of(scene: Scene, message_id: int) -> list[int]:
    return [frame.message_id for frame in scene.vehicle.received if frame.message_id == message_id]


def test_a_plan_crosses_a_link_that_loses_a_tenth_and_is_read_back_equal() -> None:
    async def play(scene: Scene) -> None:
        seen: list[JobProgress] = []
        assert await scene.services.plans.upload(plan(40), seen.append) == ()
        fractions = [p.fraction for p in seen if p.what == "uploading the mission" and p.fraction is not None]
        assert fractions == sorted(fractions)
        assert len(set(fractions)) > 20
        assert len(scene.vehicle.mission.plans[PlanType.MISSION]) == 40
        assert len((await scene.services.plans.download()).plan.items) == 40
        assert {frame.sender for frame in scene.vehicle.received} == {STATION}

    over(play, Conditions(latency_s=0.05, loss=0.1))


def test_a_cancelled_upload_is_cancelled_on_the_vehicle_and_the_old_plan_stays() -> None:
    async def play(scene: Scene) -> None:
        assert await scene.services.plans.upload(plan(2), kinds=(PlanType.MISSION,)) == ()
        await scene.pass_s(1.0)
        sent, acknowledged = len(of(scene, ITEM)), len(of(scene, ACK))
        task = asyncio.ensure_future(scene.services.plans.upload(plan(20)))
        while len(of(scene, ITEM)) < sent + 5:
            await scene.pass_s(0.05)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        await scene.pass_s(1.0)
        (reported,) = [f.decode() for f in scene.vehicle.received if f.message_id == ACK][acknowledged:]
        assert reported is not None
        assert reported.type == 15
        assert len(scene.vehicle.mission.plans[PlanType.MISSION]) == 2
        assert len((await scene.services.plans.download()).plan.items) == 2

    over(play, Conditions(latency_s=0.1))


def test_a_vehicle_that_falls_silent_is_a_refusal_in_bounded_time() -> None:
    async def play(scene: Scene) -> None:
        await scene.services.learn()
        scene.cut()
        async with asyncio.timeout(20.0):
            with pytest.raises(Refused, match="the mission was not downloaded: no answer"):
                await scene.services.plans.download()
        assert PlanResult.NO_ANSWER.words.startswith("no answer")

    over(play)


def test_closed_services_refuse() -> None:
    async def play(scene: Scene) -> None:
        await scene.services.learn()
        await scene.services.close()
        with pytest.raises(Refused, match="are closed"):
            await scene.services.plans.download()

    over(play)
