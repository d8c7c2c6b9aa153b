"""`make evidence [NAME=…]`: shows every bar in full and writes a page for each under docs/evidence."""

import sys

from tests.evidence import (
    ablation,
    avoidance,
    bad_sensor_input,
    bare_vehicles,
    browser,
    busy,
    cameras,
    campaign,
    companion,
    cost,
    day,
    dead_reckoning,
    demo,
    firmware,
    firmware_models,
    fleet,
    fleet_stations,
    flight,
    fusion,
    fuzz,
    ground,
    hosts,
    house,
    inputs,
    inspection,
    install,
    kills,
    language,
    laser,
    laser_flight,
    link,
    link_loss,
    logs,
    missions,
    mutants,
    network,
    obstacles,
    one_mission,
    operators_table,
    outliers,
    plans,
    planted,
    pose,
    px4,
    rights,
    ros2,
    router,
    security,
    sensors,
    service,
    shared_components,
    soak,
    static_proof,
    station,
    stereo,
    store,
    strangers_walk,
    suites,
    threats,
    tracker,
    tui,
    update,
    vehicle_accuracy,
    vehicles,
    wheels,
    world,
)
from tests.evidence.page import Bar, Progress, basis, commit, write

BARS: tuple[Bar, ...] = (
    *ablation.BARS,
    *avoidance.BARS,
    *bad_sensor_input.BARS,
    *bare_vehicles.BARS,
    *browser.BARS,
    *busy.BARS,
    *cameras.BARS,
    *campaign.BARS,
    *companion.BARS,
    *cost.BARS,
    *day.BARS,
    *dead_reckoning.BARS,
    *demo.BARS,
    *firmware.BARS,
    *firmware_models.BARS,
    *fleet.BARS,
    *fleet_stations.BARS,
    *flight.BARS,
    *fusion.BARS,
    *fuzz.BARS,
    *ground.BARS,
    *hosts.BARS,
    *house.BARS,
    *inputs.BARS,
    *inspection.BARS,
    *install.BARS,
    *kills.BARS,
    *language.BARS,
    *laser.BARS,
    *laser_flight.BARS,
    *link.BARS,
    *link_loss.BARS,
    *logs.BARS,
    *missions.BARS,
    *mutants.BARS,
    *network.BARS,
    *obstacles.BARS,
    *one_mission.BARS,
    *operators_table.BARS,
    *outliers.BARS,
    *planted.BARS,
    *plans.BARS,
    *pose.BARS,
    *px4.BARS,
    *rights.BARS,
    *ros2.BARS,
    *router.BARS,
    *security.BARS,
    *sensors.BARS,
    *shared_components.BARS,
    *service.BARS,
    *soak.BARS,
    *static_proof.BARS,
    *station.BARS,
    *store.BARS,
    *strangers_walk.BARS,
    *stereo.BARS,
    *suites.BARS,
    *threats.BARS,
    *tracker.BARS,
    *world.BARS,
    *tui.BARS,
    *update.BARS,
    *vehicle_accuracy.BARS,
    *vehicles.BARS,
    *wheels.BARS,
)


def main(names: list[str]) -> int:
    """Runs the bars of these names, or all; 0 if every one is met."""
    known = {bar.name: bar for bar in BARS}
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no bar {unknown[0]!r}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    of = commit()
    failed: list[str] = []
    for name in names or list(known):
        progress = Progress(name, basis(known[name].run.__module__))
        progress.report("begins")
        if not write(known[name], known[name].run(progress), of):
            failed.append(name)
        progress.report("not every figure is met" if name in failed else "met")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
