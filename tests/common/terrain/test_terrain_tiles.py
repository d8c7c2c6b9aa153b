"""Terrain tiles: read in the real format, interpolated, and what is missing or damaged told with the tile's name."""

from pathlib import Path

import numpy as np
import pytest
from tests.terrain_tiles import Shape, level, write_tile

from gloc3.errors import Refused
from gloc3.terrain import Terrain
from gloc3.terrain.tile import tile_named_by


def _slope(latitudes: np.ndarray, longitudes: np.ndarray) -> np.ndarray:
    return 1000.0 * (latitudes - 47.0) + 500.0 * (longitudes - 8.0)


def _rising_from(south: int, west: int) -> Shape:
    return lambda latitudes, longitudes: 1000.0 * (latitudes - south) + 100.0 * (longitudes - west)


@pytest.mark.parametrize("side", [1201, 3601])
@pytest.mark.parametrize("zipped", [False, True])
def test_a_tile_of_either_resolution_is_read_plain_and_zipped(tmp_path: Path, side: int, zipped: bool) -> None:
    write_tile(tmp_path, "N47E008", _slope, side=side, zipped=zipped)
    terrain = Terrain(tmp_path)
    for latitude, longitude in ((47.0, 8.0), (47.25, 8.5), (47.999, 8.001), (47.7312, 8.2689)):
        expected = 1000.0 * (latitude - 47.0) + 500.0 * (longitude - 8.0)
        assert terrain.altitude_m(latitude, longitude) == pytest.approx(expected, abs=1.0)  # whole metres in the file


def test_heights_between_four_are_bilinear(tmp_path: Path) -> None:
    step = 1.0 / 1200.0

    def corner(latitudes: np.ndarray, longitudes: np.ndarray) -> np.ndarray:
        return np.where((np.abs(latitudes - 47.5) < step / 2) & (np.abs(longitudes - 8.5) < step / 2), 100.0, 20.0)

    write_tile(tmp_path, "N47E008", corner)
    terrain = Terrain(tmp_path)
    assert terrain.altitude_m(47.5, 8.5) == pytest.approx(100.0, abs=1e-6)
    assert terrain.altitude_m(47.5, 8.5 + step / 2) == pytest.approx(60.0, abs=1e-6)
    assert terrain.altitude_m(47.5 + step / 2, 8.5 + step / 2) == pytest.approx(40.0, abs=1e-6)
    assert terrain.altitude_m(47.5 + step / 4, 8.5 - step / 4) == pytest.approx(20.0 + 80.0 * 0.5625, abs=1e-6)


def test_north_is_up_and_east_is_right_in_all_quarters_of_the_earth(tmp_path: Path) -> None:
    for name, south, west in (("N47E008", 47, 8), ("S34W071", -34, -71), ("N00W001", 0, -1), ("S01E000", -1, 0)):
        write_tile(tmp_path, name, _rising_from(south, west))
        terrain = Terrain(tmp_path)
        assert terrain.altitude_m(south + 0.9, west + 0.2) == pytest.approx(920.0, abs=1.0)
        assert terrain.altitude_m(south + 0.1, west + 0.8) == pytest.approx(180.0, abs=1.0)


def test_a_height_next_to_a_void_is_unknown_and_one_beside_it_is_not(tmp_path: Path) -> None:
    write_tile(tmp_path, "N47E008", level(400.0), void=lambda lat, lon: (lat > 47.5) & (lon > 8.5))
    terrain = Terrain(tmp_path)
    assert terrain.altitude_m(47.5, 8.4) == 400.0
    assert terrain.altitude_m(47.5, 8.5) == 400.0  # a void that weighs nothing does not count
    with pytest.raises(Refused, match=r"the terrain tile N47E008 has no height at 47\.60000, 8\.60000"):
        terrain.altitude_m(47.6, 8.6)


def test_a_missing_tile_is_told_by_its_name(tmp_path: Path) -> None:
    write_tile(tmp_path, "N47E008", level(400.0))
    with pytest.raises(Refused, match="the terrain tile S34W071 is not in"):
        Terrain(tmp_path).altitude_m(-33.5, -70.5)


def test_places_in_several_tiles_are_asked_at_once(tmp_path: Path) -> None:
    write_tile(tmp_path, "N47E008", level(400.0))
    write_tile(tmp_path, "N47E009", level(500.0), zipped=True)
    found = Terrain(tmp_path).altitudes_m(np.array([47.5, 47.5, 48.5]), np.array([8.9, 9.1, 9.1]))
    assert found[:2].tolist() == [400.0, 500.0]
    assert np.isnan(found[2])


def test_the_edge_of_a_tile_needs_no_neighbour(tmp_path: Path) -> None:
    write_tile(tmp_path, "N47E008", level(400.0))
    terrain = Terrain(tmp_path)
    for latitude, longitude in ((48.0, 8.5), (47.5, 9.0), (48.0, 9.0)):
        assert terrain.altitude_m(latitude, longitude) == 400.0


def test_the_date_line_is_one_line(tmp_path: Path) -> None:
    write_tile(tmp_path, "N51E179", level(7.0))
    write_tile(tmp_path, "N51W180", level(9.0))
    terrain = Terrain(tmp_path)
    assert terrain.altitude_m(51.5, 179.9) == 7.0
    assert terrain.altitude_m(51.5, 180.0) == terrain.altitude_m(51.5, -180.0) == terrain.altitude_m(51.5, 180.1) == 9.0


@pytest.mark.parametrize(
    ("content", "suffix", "reason"),
    [
        (b"\0" * 1000, ".hgt", "has 1,000 bytes; a tile of 1 or 3 arc seconds has 25,934,402 or 2,884,802"),
        (b"PK nonsense", ".hgt.zip", "cannot be unpacked"),
        (b"", ".hgt", "has 0 bytes"),
    ],
)
def test_a_damaged_tile_is_unknown_ground_with_the_reason(
    tmp_path: Path, content: bytes, suffix: str, reason: str
) -> None:
    (tmp_path / f"N47E008{suffix}").write_bytes(content)
    with pytest.raises(Refused, match=f"the terrain tile N47E008 cannot be used: .*{reason}"):
        Terrain(tmp_path).altitude_m(47.5, 8.5)


def test_an_archive_that_is_cut_off_or_holds_something_else_is_refused(tmp_path: Path) -> None:
    whole = write_tile(tmp_path / "whole", "N47E008", level(400.0), zipped=True).read_bytes()
    (tmp_path / "N47E008.hgt.zip").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(Refused, match="cannot be unpacked"):
        Terrain(tmp_path).altitude_m(47.5, 8.5)
    broken = bytearray(whole)
    broken[200] ^= 0xFF
    (tmp_path / "N47E008.hgt.zip").write_bytes(bytes(broken))
    with pytest.raises(Refused, match="cannot be unpacked"):
        Terrain(tmp_path).altitude_m(47.5, 8.5)


def test_a_folder_without_tiles_is_refused_and_other_files_are_left_alone(tmp_path: Path) -> None:
    (tmp_path / "readme.txt").write_text("none here")
    with pytest.raises(Refused, match=r"holds no terrain tiles, such as N47E008\.hgt"):
        Terrain(tmp_path)
    with pytest.raises(Refused, match="cannot be read: no such file or directory"):
        Terrain(tmp_path / "missing")
    write_tile(tmp_path, "N47E008", level(3.0), zipped=True, file="N47E008.SRTMGL1.hgt.zip")
    assert Terrain(tmp_path).altitude_m(47.5, 8.5) == 3.0


def test_names_of_tiles() -> None:
    assert tile_named_by("n47e008.HGT") == "N47E008"
    assert tile_named_by("S01W180.SRTMGL3.hgt.zip") == "S01W180"
    assert tile_named_by("N47E008.hgt.gz") is None
    assert tile_named_by("notes.hgt") is None
