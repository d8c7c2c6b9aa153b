"""World files: those of the package, homes, heights, and what is wrong with bad ones."""

import subprocess
import sys
from pathlib import Path

import pytest

from gloc3.errors import InputError
from gloc3.messages.frames import GeoPoint
from gloc3_sitl.physics.jsbsim_body import Quadrotor
from gloc3_sitl.world import World

pytestmark = pytest.mark.thorough

SMALL = """
world: yard
frames: {yard: {origin: {geo: [47.0, 8.0, 400.0]}, x_axis_bearing_deg: 90}}
spawn: {frame: yard, position_m: [2, 1, 0.5], heading_deg: 45}
textures: {grey: {size_m: [8, 8], resolution_px_m: 16}}
surfaces: {floor: {corner_m: [4, 4, 0], across_m: [0, -8, 0], down_m: [-8, 0, 0], texture: grey}}
boxes:
  table: {min_m: [1, 0, 0], max_m: [3, 2, 0.5], texture: grey}
  shelf: {min_m: [2.5, 0, 0.5], max_m: [3, 2, 1.5], texture: grey}
"""


def load(tmp_path: Path, text: str) -> World:
    path = tmp_path / "yard.yaml"
    path.write_text(text)
    return World.load(str(path))


def test_the_package_brings_a_hold_and_open_ground() -> None:
    assert World.names() == ["bay", "corridor", "hold", "hold_busy", "hold_hard", "open", "tank"]
    hold = World.load("hold")
    assert (hold.name, hold.frame_name) == ("hold", "hold")
    assert hold.spawn_m == (0.0, 0.0, 0.0)
    assert hold.home == pytest.approx(hold.frame.origin, abs=1e-6)
    assert hold.marker is not None
    assert len(hold.surfaces) == 9 + 3 * 5 + 6


def test_the_hold_s_walls_stand_round_everything_that_missions_use() -> None:
    corners = [
        [surface.corner_m[i] + a * surface.across_m[i] + d * surface.down_m[i] for i in range(3)]
        for surface in World.load("hold").surfaces
        for a in (0, 1)
        for d in (0, 1)
    ]
    assert [min(c[i] for c in corners) for i in range(3)] == [-3.0, -3.0, 0.0]
    assert [max(c[i] for c in corners) for i in range(3)] == [21.0, 13.0, 10.0]


def test_open_ground_goes_where_the_home_is_and_the_hold_does_not() -> None:
    home = GeoPoint(-33.9, 18.4, 12.0)
    world = World.load("open", home=home, heading_deg=123.0)
    assert world.home == pytest.approx(home, abs=1e-6)
    assert world.heading_deg == 123.0
    with pytest.raises(InputError, match="use the world open"):
        World.load("hold", home=home)


def test_a_spawn_point_on_a_box_is_the_home_and_heights_are_those_of_the_boxes(tmp_path: Path) -> None:
    world = load(tmp_path, SMALL)
    assert world.heading_deg == 45.0
    assert world.home.altitude_m == pytest.approx(400.5, abs=1e-5)
    assert world.local(*world.home) == pytest.approx((2.0, 1.0, 0.5), abs=1e-6)
    assert world.home.longitude_deg > 8.0, "x lies to the east here"
    assert world.home.latitude_deg > 47.0, "and y to the north"
    assert [world.height_at(x, 1.0) for x in (0.0, 1.5, 2.7, 4.0)] == [0.0, 0.5, 1.5, 0.0]
    assert len(world.surfaces) == 1 + 5 + 6


def test_a_vehicle_can_stand_at_the_home_of_a_world(tmp_path: Path) -> None:
    world = load(tmp_path, SMALL)
    truth = Quadrotor("pelican", world.home, heading_deg=world.heading_deg).truth()
    assert world.local(truth.latitude_deg, truth.longitude_deg, truth.altitude_m) == pytest.approx(
        (2.0, 1.0, 0.5), abs=2e-3
    )


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("frame: yard", "frame: yart", r"yard.yaml:4:\d+: no frame named 'yart' \(did you mean 'yard'\?\)"),
        ("0], texture: grey}}", "0], texture: gray}}", r"yard.yaml:6:\d+: no texture named 'gray'"),
        ("max_m: [3, 2, 0.5]", "max_m: [3, -2, 0.5]", r"yard.yaml:8:\d+: min_m must be less than max_m"),
        (
            "table: {min_m: [1, 0, 0]",
            "table: {min_m: [1, 0, -0.5]",
            r"yard.yaml:6:\d+: it intersects the box table",
        ),
        ("[2.5, 0, 0.5]", "[2.5, 0, 0.2]", r"yard.yaml:9:\d+: it is partly inside the box table"),
        ("heading_deg: 45", "headingdeg: 45", r"yard.yaml:4:\d+: .*heading"),
        ("geo: [47.0,", "geo: [147.0,", r"yard.yaml:3:"),
        ("resolution_px_m: 16", "resolution_px_m: -1", r"yard.yaml:5:"),
    ],
)
def test_mistakes_are_found_with_their_place(tmp_path: Path, old: str, new: str, says: str) -> None:
    assert old in SMALL
    with pytest.raises(InputError, match=says):
        load(tmp_path, SMALL.replace(old, new))


def test_an_unknown_name_or_file_is_told_apart() -> None:
    with pytest.raises(InputError, match="did you mean 'hold'"):
        World.load("hald")
    with pytest.raises(InputError, match="cannot be read"):
        World.load("nowhere/world.yaml")


def test_reading_a_world_loads_no_vision_library() -> None:
    code = "import sys; from gloc3_sitl.world import World; World.load('hold'); sys.exit('cv2' in sys.modules)"
    root = Path(__file__).parents[3]
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": f"{root}/common:{root}/sitl"})
