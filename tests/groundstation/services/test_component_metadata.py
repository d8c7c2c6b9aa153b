"""A vehicle describes its parameters: its files are found, compared with their checksums, cached, and never trusted."""

import lzma
from pathlib import Path

import msgspec
import pytest

from gloc3.errors import Gloc3Error, InputError, Refused
from gloc3.mavlink.codec import shape
from gloc3.mavlink.message import Address
from gloc3.mavlink.services.command import CommandResult
from gloc3.mavlink.services.command_server import MavCommandRequest
from gloc3.mavlink.services.files.ftp import checksum
from gloc3_groundstation.services.descriptions.component_metadata import (
    DescriptionCache,
    MetadataFile,
    NotOffered,
    read_general,
    read_uri,
)

from .scripted_vehicle import VEHICLE, Scene, over

PARAMETERS = lzma.compress(b'{"parameters": [{"name": "GRP0_P3", "shortDesc": "Third", "max": 9}]}')
GENERAL = MetadataFile(owner=VEHICLE, path="general.json")


def general(uri: str = "mftp://p.json.xz", crc: int = 0, **more: object) -> bytes:
    rows = [{"type": 4, "uri": "mftp://e"}, {"type": 1, "uri": uri, "fileCrc": crc, **more}]
    return msgspec.json.encode({"version": 1, "metadataTypes": rows})


def offer(scene: Scene, name: str, uri: str, crc: int) -> None:
    """Has the vehicle answer a request for one of the messages."""

    def answer(request: MavCommandRequest) -> CommandResult | None:
        if request.command != 512 or request.params[0] not in (395, 397):
            return None
        if request.params[0] != shape(name).id:
            return CommandResult.UNSUPPORTED
        prefix = "general_metadata_" if name == "COMPONENT_INFORMATION" else ""
        scene.vehicle.send(name, **{f"{prefix}uri": uri, f"{prefix}file_crc": crc})
        return CommandResult.ACCEPTED

    scene.vehicle.answer = answer


@pytest.mark.parametrize("name", ["COMPONENT_METADATA", "COMPONENT_INFORMATION"])
def test_a_vehicle_describes_its_parameters_and_is_asked_for_the_file_once(name: str, tmp_path: Path) -> None:
    (tmp_path / "p.json.xz").write_bytes(PARAMETERS)
    (tmp_path / "g.json").write_bytes(general(crc=checksum([PARAMETERS])))

    async def play(scene: Scene) -> None:
        offer(scene, name, "mftp://g.json", checksum([(tmp_path / "g.json").read_bytes()]))
        parameters = scene.services.parameters
        await parameters.fetch()
        assert await parameters.fetch_infos() == 1
        with pytest.raises(Refused, match="at most 9"):
            await parameters.set("GRP0_P3", 10)
        for file in tmp_path.iterdir():
            file.unlink()
        assert await parameters.fetch_infos() == 1, "the files are here already"

    over(play, folder=tmp_path)


@pytest.mark.parametrize(
    ("contents", "crc", "reason"),
    [
        (general(crc=0x12345678), None, "p.json.xz is damaged: its CRC-32 is .*, and the vehicle says 12345678"),
        (general(), 0xBAD, "g.json is damaged"),
        (b"{", None, "g.json: it is no general file"),
        (b"\x1b[2J", None, "g.json: it is no general file"),
        (b"\xfd7zXZ\x00garbage", None, "g.json: it cannot be unpacked"),
        (b'{"metadataTypes": [{"type": "x"}]}', None, "g.json: it is no general file"),
        (general("https://x.test/p.json"), None, "only files on the vehicle"),
        (general("mftp://\u202egpj"), None, "control characters"),
        (general("mftp://../p"), None, "leads above the top folder"),
        (general("mftp://missing"), None, "missing cannot be downloaded"),
        (general("mftp://g.json"), None, None),
    ],
)
def test_nothing_that_a_vehicle_offers_is_worse_than_a_line(
    contents: bytes, crc: int | None, reason: str | None, tmp_path: Path
) -> None:
    (tmp_path / "p.json.xz").write_bytes(PARAMETERS)
    (tmp_path / "g.json").write_bytes(contents)

    async def play(scene: Scene) -> None:
        offer(scene, "COMPONENT_METADATA", "mftp://g.json", checksum([contents]) if crc is None else crc)
        await scene.services.parameters.fetch()
        if reason is None:
            assert await scene.services.parameters.fetch_infos() == 0
        else:
            with pytest.raises(Gloc3Error, match=reason):
                await scene.services.parameters.fetch_infos()

    over(play, folder=tmp_path)


def test_a_vehicle_that_offers_nothing_is_refused_in_words(tmp_path: Path) -> None:
    async def play(scene: Scene) -> None:
        with pytest.raises(Refused, match="offers no component metadata; load a description from a file"):
            await scene.services.parameters.fetch_infos()

    over(play, folder=tmp_path)


def test_a_file_may_be_another_components_or_on_the_internet_with_a_copy_on_the_vehicle() -> None:
    assert read_uri("mftp://[;comp=191]/m/p.json", VEHICLE).owner == Address(VEHICLE.system, 191)
    with pytest.raises(Refused):
        read_uri("mftp://[;comp=999]/m/p.json", VEHICLE)
    both = general("https://x.test/p.json", uriFallback="mftp://p", fileCrcFallback=7)
    assert read_general(both, GENERAL) == MetadataFile(owner=VEHICLE, path="p", crc=7)
    with pytest.raises(NotOffered):
        read_general(b'{"metadataTypes": []}', GENERAL)
    with pytest.raises(InputError):
        read_general(b"[]", GENERAL)


def test_the_cache_outlives_the_session_and_gives_nothing_that_is_damaged(tmp_path: Path) -> None:
    crc = checksum([b"content"])
    DescriptionCache(tmp_path / "c").keep(crc, b"content")
    assert DescriptionCache(tmp_path / "c").find(crc) == b"content"
    (file,) = (tmp_path / "c").iterdir()
    file.write_bytes(b"changed")
    assert DescriptionCache(tmp_path / "c").find(crc) is None
    (tmp_path / "file").write_bytes(b"")
    DescriptionCache(tmp_path / "file").keep(crc, b"content")
