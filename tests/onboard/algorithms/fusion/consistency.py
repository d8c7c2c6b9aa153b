"""How large errors and innovations are, measured by what the fusion claims."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from .flown import Array, inspection, sensors_of
from .fly import fly

APART_S = 8.0
"""Errors so far apart in time count as independent."""


class Consistency(NamedTuple):
    """Over the seeds."""

    nees: Array
    """(seeds, moments): normalised squared error of position and attitude, six degrees of freedom."""
    innovation: dict[str, float]
    """By source: mean normalised squared innovation over its degrees of freedom."""
    ate_m: list[float]
    turn_deg: list[float]
    worst_m: list[float]
    end_m: list[float]
    distance_m: float


def consistency(platform: str, without: tuple[str, ...], seeds: Iterable[int], until_s: float = 1e9) -> Consistency:
    """Flies once with every seed."""
    flights = []
    for seed in seeds:
        sensors = [sensor for sensor in sensors_of(platform, seed) if sensor.name not in without]
        flights.append(fly(inspection(), sensors, seed, until_s=until_s))
    begin_s, end_s = 4.0, float(flights[0].t_s[-1])
    moments = np.searchsorted(flights[0].t_s, np.arange(begin_s, end_s, APART_S))
    names = [source.source for source in flights[0].fusion.state().sources if source.source not in ("imu", "height")]
    return Consistency(
        nees=np.array([flown.nees[moments] for flown in flights]),
        innovation={name: float(np.mean([flown.innovation(name) for flown in flights])) for name in names},
        ate_m=[flown.ate_m() for flown in flights],
        turn_deg=[flown.turn_deg() for flown in flights],
        worst_m=[flown.worst_m() for flown in flights],
        end_m=[float(np.linalg.norm(flown.error_m[-1])) for flown in flights],
        distance_m=inspection().distance_m,
    )
