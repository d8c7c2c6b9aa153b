"""The report and the picture of a demonstration, made from the logs that its processes have left."""

from pathlib import Path

from gloc3.exchange import LocalExchange
from gloc3.log.reader import LogReader
from gloc3.log.report.plot import plot_path
from gloc3.mission.model.model import Mission
from gloc3.platform.limits import Limits
from gloc3_sitl.flight.messages import SimTruth
from gloc3_sitl.flight.path_error import Sample
from gloc3_sitl.flight.report import as_json, as_lines, judge_within
from gloc3_sitl.flight.watch import FlightWatch


def write_report(out: Path, mission: Mission, limits: Limits, autopilot: str, total_s: float) -> list[str]:
    """Writes `report.json` and `path.svg`; returns the summary for a person.

    Raises:
        InputError: a log is missing, or is none.
    """
    exchange = LocalExchange()
    with LogReader(out / "log.mcap") as reader:
        watch = FlightWatch(exchange, reader.platform, mission.name, autopilot)
        last_s = 0.0
        for entry in reader.entries():
            last_s = entry.envelope.t_s
            if not isinstance(entry.envelope.payload, dict):
                exchange.publish(entry.envelope)
        watch.land(last_s)
    with LogReader(out / "truth.mcap") as reader:
        samples = [
            Sample(entry.envelope.t_s, entry.envelope.payload.position_ned_m)
            for entry in reader.entries("sim/truth")
            if isinstance(entry.envelope.payload, SimTruth)
        ]
    report = watch.report
    if report.mission_state in ("waiting", "running", "paused"):
        report.reason = f"interrupted while it was {report.mission_state}"
        report.mission_state = "aborted"
    judge_within(limits, report, samples, watch.path.flights)
    report.wall = {"total_s": round(total_s, 3), "real_time_factor": 1.0}
    (out / "report.json").write_bytes(as_json(report))
    flown = [sample.position_ned_m for sample in samples]
    home = flown[0] if flown else None
    plot_path(flown, watch.path.points_ned_m, out / "path.svg", home=home, fence=mission.fence, title=mission.name)
    kept = "log.mcap, truth.mcap, report.json, path.svg" + (", images" if report.images else "")
    return [*as_lines(report), f"  kept     {kept} in {out}"]
