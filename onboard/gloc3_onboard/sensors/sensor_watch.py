"""Monitors the sensors of an onboard process: whether they produce data, and whether their calibrations fit."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gloc3.camera.model import misfit
from gloc3.errors import Gloc3Error
from gloc3.messages.readiness import SensorCondition
from gloc3.messages.vehicle import Image
from gloc3_onboard.sensors.devices import Rig
from gloc3_onboard.sensors.registry import NOWHERE, parse_source, place_problem, sensor_of


class SensorWatch:
    """Time of each sensor's last data.

    Args:
        urls: the sources by device; of a device of the simulation a word for it.
        sources: the devices.
        rig: the calibrations.
        now_s: our time.
    """

    def __init__(
        self, urls: Mapping[str, str], sources: Mapping[str, Any], rig: Rig, now_s: Callable[[], float]
    ) -> None:
        self._urls, self._sources, self._rig, self._now_s = urls, sources, rig, now_s
        self._new_data_s: dict[str, float] = {}
        for name, source in sources.items():
            listen = getattr(source, "on_new_data", None)
            if listen is not None:
                listen(partial(self._came, name))

    def _came(self, name: str) -> None:
        self._new_data_s[name] = self._now_s()

    def conditions(self) -> list[SensorCondition]:
        """Condition of each sensor; those whose data are not counted, as the autopilot's height, are left out."""
        return [
            self._condition(name, source) for name, source in self._sources.items() if hasattr(source, "on_new_data")
        ]

    def _condition(self, name: str, source: Any) -> SensorCondition:
        now_s = self._now_s()
        problem = ""
        uncalibrated: list[str] = []
        if not self._urls[name].startswith(NOWHERE):
            uncalibrated = [camera for camera in cameras_of(name) if self._rig.model(camera) is None]
            try:
                problem = self._misfit(_images(name, source))
            except Gloc3Error as error:
                problem = str(error)
        return SensorCondition(
            device=name,
            source=self._urls[name],
            problem=problem,
            age_s=round(now_s - self._new_data_s[name], 1) if name in self._new_data_s else -1.0,
            uncalibrated=uncalibrated,
            is_open=True,
        )

    def _misfit(self, images: Sequence[Image]) -> str:
        """Why pictures do not fit their calibration."""
        models = [(self._rig.model(image.camera), image) for image in images if image.data]
        found = [misfit(model, image.width, image.height) for model, image in models if model is not None]
        return next(filter(None, found), "")


def _images(name: str, source: Any) -> Sequence[Image]:
    """A camera's current images; empty for other sensors.

    Raises:
        Gloc3Error: the sensor is lost.
    """
    sensor = sensor_of(name)
    return () if sensor is None else sensor.poll(source)


def cameras_of(device: str) -> tuple[str, ...]:
    """Names of a device's cameras; empty if it is no camera."""
    sensor = sensor_of(device)
    return () if sensor is None else sensor.cameras(device)


def unopened_conditions(
    urls: Mapping[str, str], folder: Path, calibrated: Callable[[str], bool], wrong: Mapping[str, str]
) -> list[SensorCondition]:
    """Conditions of sensors, as far as known without opening them.

    Args:
        urls: the sources by device.
        folder: base of relative file names.
        calibrated: whether a camera has a calibration.
        wrong: reasons why cameras' calibrations cannot be used.
    """
    found: list[SensorCondition] = []
    for name, text in urls.items():
        cameras = cameras_of(name)
        try:
            url = parse_source(name, text)
        except Gloc3Error as error:
            found.append(SensorCondition(device=name, source=text, problem=str(error)))
            continue
        is_there = not url.text.startswith(NOWHERE)
        problems = [place_problem(url, folder), *(wrong.get(camera, "") for camera in cameras)]
        found.append(
            SensorCondition(
                device=name,
                source=text,
                problem="; ".join(filter(None, problems)),
                uncalibrated=[camera for camera in cameras if is_there and not calibrated(camera)],
            )
        )
    return found
