"""Keys in a token: requests are signed there, by the real PKCS #11 library of SoftHSM."""

import asyncio
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from pkcs11 import lib
from tests.common.network.test_network_files import network
from tests.common.network.test_stations_on_the_network import Server, request
from tests.common.network.yard import LONG, NOW, Yard

from gloc3.errors import InputError, Refused
from gloc3.exchange import LocalExchange, Publisher
from gloc3.messages.command_interface import CiRequest, Hello
from gloc3.messages.envelope import Envelope, Source
from gloc3.messages.topics import TopicTable
from gloc3.messages.wire import type_name
from gloc3.network import register
from gloc3.network.access import MemberRole
from gloc3.network.authority import read_certificate, read_key
from gloc3.network.enrolment import make_request, read_request
from gloc3.network.file import read_network
from gloc3.network.security_token import PIN_VARIABLE, TokenKey, TokenPlace
from gloc3.network.signatures import RequestSigner
from gloc3.network.stations import join_platforms

SOFTHSM = Path("/usr/lib/softhsm/libsofthsm2.so")
PIN = "4711"
token_here = pytest.mark.skipif(
    not SOFTHSM.exists() or shutil.which("softhsm2-util") is None, reason="no SoftHSM: apt-get install softhsm2"
)


@pytest.fixture(scope="module")
def softhsm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder with a token for each of two people; the library reads its place once in a process."""
    folder = tmp_path_factory.mktemp("softhsm")
    (folder / "tokens").mkdir()
    (folder / "softhsm2.conf").write_text(f"directories.tokendir = {folder}/tokens\nlog.level = ERROR\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOFTHSM2_CONF", str(folder / "softhsm2.conf"))
        for label in ("alice", "mallory", "lost"):
            make = ["softhsm2-util", "--init-token", "--free", "--label", label, "--pin", PIN, "--so-pin", "00000000"]
            subprocess.run(make, check=True, stdout=subprocess.DEVNULL)
        patch.setenv(PIN_VARIABLE, PIN)
        yield folder


def uri(token: str, more: str = "") -> str:
    return f"pkcs11:token={token}?module-path={SOFTHSM}{more}"


ASKED = request("alice", 0, Hello())


def ask() -> Envelope[CiRequest]:
    source = Source("alice", "ci", 9)
    return Envelope("pelican/ci/request/alice", source, 0, 0.0, "", type_name(CiRequest), ASKED)


class Laptop:
    """Alice's computer: her link's key in its folder, the key of her requests in a token."""

    def __init__(self, folder: Path, token: str = "alice") -> None:
        self.yard, self.folder = Yard(folder / "yard"), folder / "laptop"
        assert network("request", self.folder, "alice", "--token", uri(token)) == 0
        path = self.folder / "request.pem"
        assert network("add", self.yard.folder, "alice", "--role", "operator", "--request", path, "--renew") == 0
        self.copy()

    def copy(self) -> None:
        """Copies what the network's folder has for her."""
        shutil.copytree(self.yard.folder / "alice", self.folder, dirs_exist_ok=True)

    def opened(self, signer: RequestSigner) -> CiRequest:
        """What a vehicle finds in a request that was signed."""
        types, now_s = TopicTable.installed().types, NOW.timestamp()
        signed = signer.sign(ask(), types, until_s=5.0, boot=3, utc_s=now_s)
        found = self.yard.membership("pelican.main").verifier().open(signed, "alice", types, now_s).payload
        assert isinstance(found, CiRequest)
        return found


@token_here
@pytest.mark.usefixtures("softhsm")
def test_requests_are_signed_in_the_token_and_the_key_of_the_link_signs_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    laptop = Laptop(tmp_path)
    told = re.findall(r"fingerprint of the key: ([0-9a-f ]{29})", capsys.readouterr().err)
    assert len(told) == 2
    assert told[0] == told[1], "both sides read out the same"
    assert network("check", laptop.folder / "network.yaml") == 0
    own = read_network(laptop.folder / "network.yaml", NOW)
    assert laptop.opened(own.signer()) == ASKED
    link = RequestSigner(read_key(laptop.folder / "key.pem"), read_certificate(laptop.folder / "certificate.pem"))
    with pytest.raises(Refused, match="which is not accepted"):
        laptop.opened(link)
    secrets = [path.name for path in laptop.folder.rglob("*") if "PRIVATE KEY" in path.read_text()]
    assert secrets == ["key.pem"]
    former = own.file.own
    assert network("renew", laptop.yard.folder, "alice") == 0
    laptop.copy()
    own = read_network(laptop.folder / "network.yaml", NOW)
    assert own.file.own.signs not in {"", former.signs}
    assert laptop.opened(own.signer()) == ASKED


@token_here
@pytest.mark.usefixtures("softhsm")
async def test_a_vehicle_takes_what_the_token_signs_and_a_token_that_is_lost_is_told(tmp_path: Path) -> None:
    laptop, topics, unsent = Laptop(tmp_path, "lost"), TopicTable.installed(), list[str]()
    own = read_network(laptop.folder / "network.yaml", NOW)
    with laptop.yard.open("pelican.main") as main, laptop.yard.open("alice", own) as outside:
        server, inside = Server(main, laptop.yard), LocalExchange(topics)
        part = join_platforms(outside, inside, topics, "alice", signer=own.signer(), unsent=unsent.append)
        publisher = Publisher(inside, "alice", "ci", 9)

        async def say(is_enough: Callable[[], object]) -> None:
            async with asyncio.timeout(30.0):
                while not is_enough():
                    server.summarise()
                    publisher.publish("pelican/ci/request", request("alice", 0, Hello()), 0.0)
                    await asyncio.sleep(0.03)

        await say(lambda: server.used)
        assert server.used[0].payload.member == "alice"
        assert unsent == []
        subprocess.run(["softhsm2-util", "--delete-token", "--token", "lost"], check=True, stdout=subprocess.DEVNULL)
        await say(lambda: unsent)
        lib(str(SOFTHSM)).reinitialize()  # SoftHSM is of no use to this process otherwise
        assert unsent[0].startswith("not sent: "), unsent
        assert "token" in unsent[0]
        part()
        server.bridge.close()


@token_here
@pytest.mark.usefixtures("softhsm")
def test_another_token_no_key_and_a_missing_folder_are_refused(tmp_path: Path) -> None:
    laptop = Laptop(tmp_path)
    own = read_network(laptop.folder / "network.yaml", NOW)
    with pytest.raises(Refused, match="no token 'nora': is it plugged in"):
        TokenKey(uri("nora"))
    with pytest.raises(Refused, match="has no key 'other'"):
        TokenKey(f"pkcs11:token=mallory;object=other?module-path={SOFTHSM}")
    make_request(tmp_path / "mallory", "mallory", uri("mallory"))
    shutil.copy(tmp_path / "mallory" / "token.uri", laptop.folder)
    with pytest.raises(Refused, match=r"is not that of signing\.pem: is it the right token"):
        own.signer()
    (laptop.folder / "token.uri").unlink()
    with pytest.raises(InputError, match=r"token\.uri: cannot be read"):
        own.signer()
    (laptop.folder / "signing.pem").unlink()
    with pytest.raises(InputError, match=r"signing\.pem: cannot be read"):
        read_network(laptop.folder / "network.yaml", NOW)
    keys = read_request(tmp_path / "mallory" / "request.pem", "mallory")
    entry = register.NetworkMember(role=MemberRole.OBSERVER, certificate="", until="")
    with pytest.raises(Refused, match="mallory signs no requests"):
        register.add(laptop.yard.folder, "mallory", entry, NOW, LONG, is_renewed=False, keys=keys)


@token_here
def test_a_wrong_pin_is_told_and_comes_from_a_file_that_only_its_user_can_read(softhsm: Path) -> None:
    # In a process of its own: a token stays open for all of a process once its PIN was right.
    path = softhsm / "pin"
    path.write_text("0000")
    path.chmod(0o600)
    program = "import sys\nfrom gloc3.network.security_token import TokenKey\nTokenKey(sys.argv[1])"
    told = subprocess.run(
        [sys.executable, "-c", program, uri("mallory", f"&pin-source=file:{path}")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.stderr.splitlines()[-1].endswith(
        "the PIN of the token mallory is wrong; it locks after a few wrong ones"
    ), told.stderr
    path.chmod(0o644)
    with pytest.raises(Refused, match="other users can read the PIN"):
        TokenKey(uri("mallory", f"&pin-source=file:{path}"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("alice", "is no PKCS #11 URI; for example pkcs11:"),
        ("pkcs11:token=alice", "has no module-path"),
        ("pkcs11:", "has no token and no module-path"),
        ("pkcs11:token=a?module-path=/m&pin-value=1234", "a PIN in the URI can be read by everyone"),
        ("pkcs11:token=a;slot=3?module-path=/m", "slot is not known here; known are token"),
    ],
)
def test_uris_that_do_not_name_a_token_are_refused(text: str, message: str) -> None:
    with pytest.raises(Refused, match=re.escape(message)):
        TokenPlace.read(text)


def test_a_uri_is_read_with_its_escapes() -> None:
    place = TokenPlace.read(
        "pkcs11:token=my%20key;serial=12;object=orders?module-path=/usr/lib/x.so&pin-source=file:/a"
    )
    assert place == TokenPlace("/usr/lib/x.so", "my key", "12", "orders", "/a")
