"""Parameters over a link: listed with progress whatever is lost, set and read back, refused in words, cancelled."""

import asyncio
from pathlib import Path

import pytest

from gloc3.errors import Refused
from gloc3.mavlink.services.parameter import ParameterType, parameter
from gloc3.mavlink.transport.memory import Conditions
from gloc3_groundstation.services.parameter_table import ParameterChange, ParameterTable
from gloc3_groundstation.services.progress import JobProgress

from .scripted_vehicle import ARDUPILOT, PX4, Scene, numbered, over


@pytest.mark.parametrize("autopilot", [PX4, ARDUPILOT])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_the_list_is_fetched_with_progress(autopilot: int, loss: float) -> None:
    async def play(scene: Scene) -> None:
        seen: list[JobProgress] = []
        table = await scene.services.parameters.fetch(seen.append)
        assert {row.name: row.value for row in table} == {one.name: one.value for one in numbered()}
        fractions = [progress.fraction for progress in seen if progress.fraction is not None]
        assert fractions == sorted(fractions)
        assert seen[-1] == JobProgress(what="listing the parameters", fraction=1.0, detail="40 of 40")
        assert scene.services.snapshots.title in ("PX4 1.15.4, system 1", "ArduPilot 4.6.0, system 1")

    over(play, Conditions(loss=loss, latency_s=0.05), autopilot=autopilot)


def test_a_parameter_is_set_and_read_back_and_the_table_follows() -> None:
    async def play(scene: Scene) -> None:
        parameters = scene.services.parameters
        await parameters.fetch()
        before, reported = parameters.table, list[ParameterTable]()
        parameters.listen(reported.append)
        row = await parameters.set("GRP0_P3", 33)
        assert (row.value, row.is_changed) == (33, True)
        assert scene.vehicle.parameters["GRP0_P3"] == 33
        assert parameters.table["GRP0_P3"].value == reported[-1]["GRP0_P3"].value == 33
        assert before["GRP0_P3"].value == 3

    over(play, Conditions(loss=0.2, latency_s=0.05))


def test_what_the_vehicle_does_not_take_is_refused_with_what_it_keeps() -> None:
    async def play(scene: Scene) -> None:
        await scene.services.parameters.fetch()

        def check(wanted: object) -> None:
            raise Refused("not in flight")

        scene.vehicle.parameters._check = check
        with pytest.raises(Refused, match=r"GRP0_P3 was not set: the vehicle keeps another value \(3\)"):
            await scene.services.parameters.set("GRP0_P3", 33)
        assert scene.services.parameters.table["GRP0_P3"].value == 3

    over(play)


def test_another_stations_change_is_seen() -> None:
    async def play(scene: Scene) -> None:
        parameters = scene.services.parameters
        await parameters.fetch()
        scene.vehicle.parameters.set("GRP0_P0", 5)
        scene.vehicle.runner.settle()
        await scene.pass_s(1.0)
        assert parameters.table["GRP0_P0"].value == 5

    over(play)


def test_a_file_is_saved_compared_and_written(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        parameters = scene.services.parameters
        with pytest.raises(Refused, match="fetch the parameters first"):
            parameters.compare(tmp_path / "x.parm")
        await parameters.fetch()
        for suffix in (".params", ".parm", ".param"):
            file = tmp_path / f"saved{suffix}"
            assert parameters.save(file) == 40
            assert parameters.compare(file).changes() == ()
        with pytest.raises(Refused, match="must end in"):
            parameters.save(tmp_path / "saved.txt")
        text = (tmp_path / "saved.parm").read_text()
        (tmp_path / "other.parm").write_text(text.replace("GRP2_P2          2.25", "GRP2_P2 7.5"))
        diff = parameters.compare(tmp_path / "other.parm")
        assert diff.changes() == (ParameterChange("GRP2_P2", 7.5),)
        report = await parameters.write((*diff.changes(), ParameterChange("GRP1_P1", 200), ParameterChange("NONE", 1)))
        assert report.written == (ParameterChange("GRP2_P2", 7.5),)
        assert sorted(report.refused) == ["GRP1_P1", "NONE"]
        assert scene.vehicle.parameters["GRP2_P2"] == 7.5

    over(play)


def test_a_vehicle_that_falls_silent_is_not_waited_for() -> None:
    async def play(scene: Scene) -> None:
        parameters, loop = scene.services.parameters, asyncio.get_running_loop()
        await parameters.fetch()
        scene.cut()
        begun_s = loop.time()
        report = await parameters.write([ParameterChange(f"GRP0_P{number}", 1) for number in range(0, 30, 3)])
        assert loop.time() - begun_s < 15.0
        assert report.written == ()
        assert len(report.refused) == 10
        assert report.refused["GRP0_P27"] == "not tried: the vehicle does not answer"
        with pytest.raises(Refused, match="not listed: no answer"):
            await parameters.fetch()
        assert loop.time() - begun_s < 30.0

    over(play)


def test_a_fetch_is_cancelled_and_another_one_works() -> None:
    async def play(scene: Scene) -> None:
        parameters = scene.services.parameters
        task = asyncio.ensure_future(parameters.fetch())
        await scene.pass_s(0.1)
        task.cancel()
        with pytest.raises(asyncio.CancelledError):
            await task
        assert len(await parameters.fetch()) == 40

    over(play, Conditions(latency_s=0.05))


def test_the_vehicles_own_description_gives_the_bounds(tmp_path: Path) -> None:
    (tmp_path / "etc" / "extras").mkdir(parents=True)
    rows = b'{"parameters": [{"name": "GRP0_P3", "shortDesc": "Third", "min": 0, "max": 9, "rebootRequired": true}]}'
    import lzma

    (tmp_path / "etc" / "extras" / "parameters.json.xz").write_bytes(lzma.compress(rows))

    async def play(scene: Scene) -> None:
        parameters = scene.services.parameters
        await parameters.fetch()
        assert await parameters.fetch_infos() == 1
        with pytest.raises(Refused, match="at most 9"):
            await parameters.set("GRP0_P3", 10)
        assert (await parameters.write([ParameterChange("GRP0_P3", 8)])).needs_restart == ("GRP0_P3",)
        assert (await parameters.fetch())["GRP0_P3"].info.title == "Third"

    over(play, folder=tmp_path)


def test_an_integer_that_is_no_float_travels_both_ways() -> None:
    async def play(scene: Scene) -> None:
        await scene.services.parameters.fetch()
        assert (await scene.services.parameters.set("BITS", -5)).value == -5

    over(play, parameters=[parameter("BITS", 0x7FA00001, ParameterType.INT32)])
