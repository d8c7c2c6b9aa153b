"""Maps as files: what is written is read again, by an image program, too; what cannot be used is told with its place."""

import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gloc3.errors import InputError
from gloc3.messages.perception import CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, OccupancyMap
from gloc3.terrain.map_file import read_map, write_map

STATES = np.array(
    [
        [[CELL_FREE, CELL_OCCUPIED, CELL_UNKNOWN, CELL_FREE], [CELL_FREE, CELL_FREE, CELL_FREE, CELL_FREE]],
        [
            [CELL_UNKNOWN, CELL_UNKNOWN, CELL_UNKNOWN, CELL_UNKNOWN],
            [CELL_UNKNOWN, CELL_FREE, CELL_UNKNOWN, CELL_UNKNOWN],
        ],
    ],
    np.uint8,
)
KNOWN = OccupancyMap(
    corner_ne_m=(-1.2, 3.4),
    cell_m=0.1,
    rows=2,
    columns=4,
    layer_m=0.5,
    levels=[-1, 2],
    cells=zlib.compress(STATES.tobytes()),
)
FOREIGN = """\
image: a.png
resolution: 0.05
origin: [1.0, -2.0, 0.0]
negate: 1
occupied_thresh: 0.6
free_thresh: 0.3
layer_m: 1.0
layers: [{number: 0, image: a.png}]
"""


def test_a_map_is_read_as_it_was_written_and_north_is_up_in_its_images(tmp_path: Path) -> None:
    files = write_map(tmp_path / "hold.yaml", KNOWN)
    assert [file.name for file in files] == ["hold.yaml", "hold--1.pgm", "hold-2.pgm"]
    found = read_map(tmp_path / "hold.yaml")
    assert found.layers() == KNOWN.layers()
    assert (found.corner_ne_m, found.cell_m, found.layer_m, found.levels) == ((-1.2, 3.4), 0.1, 0.5, [-1, 2])
    assert "image: hold--1.pgm" in (tmp_path / "hold.yaml").read_text()
    grey = np.asarray(Image.open(tmp_path / "hold--1.pgm"))
    assert grey.tolist() == [[254, 254, 254, 254], [254, 0, 205, 254]], "the last row is the southernmost"


def test_maps_of_other_programs_are_read_by_their_thresholds(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text(FOREIGN)
    Image.fromarray(np.array([[255, 0], [128, 140]], np.uint8)).save(tmp_path / "a.png")
    found = read_map(tmp_path / "map.yaml")
    assert found.layers() == [bytes((CELL_UNKNOWN, CELL_UNKNOWN, CELL_OCCUPIED, CELL_FREE))]
    assert (found.corner_ne_m, found.cell_m) == ((-2.0, 1.0), 0.05)


@pytest.mark.parametrize(
    ("was", "becomes", "message"),
    [
        ("0.0]", "0.3]", r"map\.yaml: origin: a map that is turned by 0\.3 rad is not read"),
        ("resolution: 0.05", "resolution: 0", r"map\.yaml:2:13: resolution: "),
        ("image: a.png}", "image: b.png}", r"b\.png: cannot be read: No such file"),
        ("image: a.png}", "image: map.yaml}", r"map\.yaml: it is no image \(PGM or PNG\)"),
        ("layers: [{number: 0, image: a.png}]", "layers: []", "layers: there are none"),
        ("layer_m: 1.0\n", "layer_m: 1.0\nmode: scale\n", "mode: 'scale' is not read, only 'trinary'"),
        ("image: a.png}]", "image: a.png}, {number: 1, image: c.png}]", "its images are of different sizes"),
        ("layer_m: 1.0\n", "", "layer_m"),
    ],
)
def test_a_map_that_cannot_be_used_is_told(tmp_path: Path, was: str, becomes: str, message: str) -> None:
    (tmp_path / "map.yaml").write_text(FOREIGN.replace(was, becomes))
    Image.fromarray(np.zeros((2, 2), np.uint8)).save(tmp_path / "a.png")
    Image.fromarray(np.zeros((3, 2), np.uint8)).save(tmp_path / "c.png")
    with pytest.raises(InputError, match=message):
        read_map(tmp_path / "map.yaml")
