"""`gloc3 network`: what it writes, and what it says of files that are wrong."""

import re
import shutil
from datetime import timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import Encoding
from tests.common.network.yard import LONG, NOW, Yard

from gloc3.cli.program import run
from gloc3.errors import InputError, Refused
from gloc3.network.access import Accepted, MemberRole, grants
from gloc3.network.enrolment import make_request, read_request
from gloc3.network.file import read_network
from gloc3.network.register import NETWORK_FILE, found, read_register
from gloc3.network.rights_file import RIGHTS_FILE


def network(*arguments: object) -> int:
    return run(["network", *map(str, arguments)])


@pytest.mark.thorough
def test_a_network_is_made_by_a_few_commands_and_only_its_own_folder_holds_the_authoritys_key(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    yard = tmp_path / "yard"
    assert network("init", yard) == 0
    assert network("add", yard, "alice", "--role", "operator") == 0
    assert "no member listens yet" in capsys.readouterr().err
    listen = ("--listen", "0.0.0.0:7447", "--reached-at", "192.168.1.10:7447")
    assert network("add", yard, "pelican.main", "--role", "platform", *listen) == 0
    assert "the files changed for alice" in capsys.readouterr().err
    assert network("add", yard, "pelican.vision", "--role", "platform") == 0
    assert network("add", yard, "bob", "--role", "observer") == 0
    assert "changed for pelican.main, pelican.vision:" in capsys.readouterr().err
    for name in ("alice", "pelican.vision"):
        assert read_network(yard / name / NETWORK_FILE, NOW).file.connect == ["192.168.1.10:7447"]
    main = read_network(yard / "pelican.main" / NETWORK_FILE, NOW).node()
    assert (main.listen, main.connect) == (("tls/0.0.0.0:7447",), ())
    assert main.peers == ()
    vision = read_network(yard / "pelican.vision" / NETWORK_FILE, NOW).node()
    assert vision.client_of == ("pelican.main",)
    assert network("add", yard, "heron.main", "--role", "platform", "--listen", "192.168.1.11:7447") == 0
    main, alice = (read_network(yard / name / NETWORK_FILE, NOW).node() for name in ("pelican.main", "alice"))
    assert (sorted(main.peers), alice.client_of, len(alice.connect)) == (["alice", "bob"], (), 2)
    keys = [path for path in yard.rglob("*") if "PRIVATE KEY" in (path.read_text() if path.is_file() else "")]
    assert {path.relative_to(yard).as_posix() for path in keys} == {
        "authority.key",
        *(f"{name}/key.pem" for name in read_register(yard).members),
    }
    assert all(path.stat().st_mode & 0o077 == 0 for path in keys)
    capsys.readouterr()
    assert network("check", yard / "alice" / NETWORK_FILE) == 0
    assert network("show", yard / "pelican.main" / NETWORK_FILE) == 0
    shown = capsys.readouterr().out
    assert (
        "may put here: pelican/ci/request/alice, pelican/demand/alice, pelican/ci/ask/alice, stations/alice/**" in shown
    )
    assert "may put here: pelican/ci/ask/bob, stations/bob/**" in shown
    assert network("revoke", yard, "bob") == 0
    assert "bob" not in (yard / "pelican.main" / NETWORK_FILE).read_text()
    assert network("revoke", yard, "bob") == 2
    assert network("add", yard, "alice", "--role", "operator") == 2
    assert "alice is already a member" in capsys.readouterr().err
    with pytest.raises(Refused, match="already holds a network"):
        found(yard, "yard", NOW, LONG)


@pytest.mark.parametrize(
    ("old", "new", "finding"),
    [
        ("member: ", "membr: ", r":4:1: unknown key 'membr' \(did you mean 'member'\?\)"),
        ('member: "alice"', 'member: "alicia"', r":4:9: 'alicia' is not in its own list .*did you mean 'alice'"),
        ("role: operator", "role: pilot", r":\d+:\d+: .*operator"),
        ("7447", "74470", r":14:11: 74470 is not a port"),
        ("connect: [", "connect: [nowhere, ", r":14:11: 'nowhere' is not an address"),
        ("connect: [", "connect: [udp/10.0.0.1:7447, ", r":14:11: 'udp/10.0.0.1:7447' is not an address .*quic/HOST"),
        ('member: "pelican.main"', 'member: "pelican"', r":\d+:\d+: 'pelican' is not a host of a platform"),
        ("- {", "- {serial: 1, ", r"unknown key 'serial'"),
        ("key: key.pem", "key: nothing.pem", "nothing.pem: cannot be read: No such file"),
        ("key: key.pem", "key: authority.pem", "authority.pem: .*(other users can access|not a private key)"),
        (
            "certificate: certificate.pem",
            "certificate: authority.pem",
            "it belongs to 'yard authority', not to 'alice/",
        ),
    ],
)
def test_a_network_file_that_is_wrong_is_refused_at_the_place(tmp_path: Path, old: str, new: str, finding: str) -> None:
    yard = Yard(tmp_path / "yard", "192.168.1.10:7447")
    file = yard.folder / "alice" / NETWORK_FILE
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    with pytest.raises(InputError, match=finding):
        read_network(file, NOW)


def test_keys_and_certificates_that_do_not_fit_or_are_open_to_others_are_refused(tmp_path: Path) -> None:
    yard, other = Yard(tmp_path / "yard"), Yard(tmp_path / "other")
    file = yard.folder / "alice" / NETWORK_FILE
    key = file.with_name("key.pem")
    key.chmod(0o640)
    with pytest.raises(InputError, match=r"key\.pem: other users can access this key \(mode 0640\)"):
        read_network(file, NOW)
    key.chmod(0o600)
    with pytest.raises(InputError, match=r"certificate\.pem: it expired on .*renew"):
        read_network(file, NOW + 2 * LONG)
    with pytest.raises(InputError, match="is this computer's clock right"):
        read_network(file, NOW - timedelta(days=400))
    shutil.copy(other.folder / "alice" / "key.pem", key)
    with pytest.raises(InputError, match=r"key\.pem: this is not the key of certificate\.pem"):
        read_network(file, NOW)
    shutil.copy(other.folder / "authority.pem", file.with_name("authority.pem"))
    with pytest.raises(InputError, match=r"authority\.pem has not signed this certificate"):
        read_network(file, NOW)


def test_a_member_keeps_its_key_on_its_own_computer_and_is_renewed_before_its_certificate_ends(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    yard, laptop = Yard(tmp_path / "yard"), tmp_path / "laptop"
    assert network("request", laptop, "dora") == 0
    digits = capsys.readouterr().err.rpartition("key: ")[2].strip()
    assert len(digits.split()) == 6
    asked = ("--role", "operator", "--request", laptop / "request.pem")
    assert network("add", yard.folder, "erin", *asked) == 2
    assert "it is of dora, not of erin" in capsys.readouterr().err
    assert network("add", yard.folder, "dora", *asked, "--days", "20") == 0
    told = capsys.readouterr().err
    assert f"fingerprint of the key: {digits}; it has to be the one that dora reads out" in told
    public = yard.folder / "dora"
    assert sorted(path.name for path in public.iterdir()) == [
        "authority.pem",
        "certificate.pem",
        "network.yaml",
        "revocations.pem",
    ]
    key = (laptop / "key.pem").read_bytes()

    def check() -> str:
        for path in public.iterdir():
            shutil.copy(path, laptop)
        assert network("check", laptop / NETWORK_FILE) == 0
        return capsys.readouterr().err

    assert re.search(r"certificate\.pem expires on .*, in (19|20) days: gloc3 network renew", check())
    before = yard.membership("pelican.main").file
    assert network("renew", yard.folder, "--within", "25") == 0
    assert "renewed: dora\n" in capsys.readouterr().err, "the others expire later"
    assert "expires" not in check()
    assert (laptop / "key.pem").read_bytes() == key
    after = yard.membership("pelican.main").file
    changed = {one.member for one in after.accepts} - {one.member for one in after.accepts if one in before.accepts}
    assert changed == {"dora"}
    alice = (yard.folder / "alice" / "key.pem").read_bytes()
    assert network("renew", yard.folder, "alice") == 0
    assert (yard.folder / "alice" / "key.pem").read_bytes() != alice, "made here, it is made anew"
    yard.membership("alice")
    assert network("renew", yard.folder, "nobody") == 2
    assert network("renew", yard.folder, "--within", "0") == 0
    assert "nothing expires within 0 days" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "cannot be read"),
        (b"-----BEGIN CERTIFICATE REQUEST-----", "not a request"),
        ("changed", "its signature is wrong"),
    ],
)
def test_a_request_that_is_none_is_refused(tmp_path: Path, content: bytes | str | None, message: str) -> None:
    make_request(tmp_path, "dora")
    path = tmp_path / "request.pem"
    if content is None:
        path.unlink()
    elif content == "changed":
        request = x509.load_pem_x509_csr(path.read_bytes())
        data = bytearray(request.public_bytes(Encoding.DER))
        data[data.index(b"dora")] = ord("n")
        path.write_bytes(x509.load_der_x509_csr(bytes(data)).public_bytes(Encoding.PEM))
    else:
        assert isinstance(content, bytes)
        path.write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_request(path, "nora" if content == "changed" else "dora")


def test_rights_are_checked_shown_and_copied_and_a_copy_that_is_missing_gives_nobody_everything(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    yard = Yard(tmp_path / "yard")
    assert network("rights", yard.folder) == 2
    assert "every operator may command every platform" in capsys.readouterr().err
    assert network("show", yard.folder / "pelican.main" / NETWORK_FILE) == 0
    assert "rights: every operator may do everything" in capsys.readouterr().out
    wrong = "rights: [{member: alice, role: pilot, of: [all]}]"
    (yard.folder / RIGHTS_FILE).write_text(wrong)
    assert network("rights", yard.folder) == 2
    assert network("revoke", yard.folder, "bob") == 2, "nor is anything else written"
    assert "rights.yaml:1:" in capsys.readouterr().err
    (yard.folder / RIGHTS_FILE).write_text(wrong.replace("pilot", "operator, until: 2030-01-01"))
    assert network("rights", yard.folder) == 0
    told = capsys.readouterr()
    assert "changed for pelican.main, pelican.vision: copy the folder there" in told.err
    line = "  alice: operator until 2030-01-02 00:00 UTC; looking, holding control, flying and steering"
    assert line in told.out
    assert network("rights", yard.folder) == 0
    assert "changed" not in capsys.readouterr().err
    assert network("show", yard.folder / "pelican.main" / NETWORK_FILE) == 0
    assert line in capsys.readouterr().out
    assert yard.membership("alice").rights is None
    (yard.folder / "pelican.main" / RIGHTS_FILE).unlink()
    with pytest.raises(InputError, match=r"network\.yaml:\d+:\d+: rights\.yaml is not there"):
        yard.membership("pelican.main")


def test_no_role_may_say_what_is_anothers() -> None:
    def accepted(member: str, role: MemberRole) -> Accepted:
        return Accepted(member=member, role=role, certificate="1")

    main, other = accepted("pelican.main", MemberRole.PLATFORM), accepted("hummingbird.main", MemberRole.PLATFORM)
    alice, bob = accepted("alice", MemberRole.OPERATOR), accepted("bob", MemberRole.OBSERVER)

    def text(own: Accepted, theirs: Accepted) -> set[str]:
        return {
            key
            for grant in grants(own, theirs)
            if (grant.flow, grant.speech) == ("ingress", "say")
            for key in grant.keys
        }

    assert text(main, alice) == {
        "pelican/ci/request/alice",
        "pelican/demand/alice",
        "pelican/ci/ask/alice",
        "stations/alice/**",
        "members/alice/**",
    }
    assert text(main, bob) == {"pelican/ci/ask/bob", "stations/bob/**", "members/bob/**"}
    assert text(main, other) == {
        "members/**",
        *(f"hummingbird/ci/{name}" for name in ("summary", "mission", "control")),
    }
    assert text(alice, main) == {"pelican/**", "stations/**", "members/**"}
    assert text(alice, bob) == set()
