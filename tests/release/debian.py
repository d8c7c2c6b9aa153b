"""Debian packages: one environment each, in a folder of its version, for one computer and one Python.

An environment holds the wheel with everything that it requires, at the locked versions, so that installation needs no
network. Each version is a package of its own name, as kernels are: to install one changes nothing that runs, and
`gloc3 update` switches. Nothing of the target runs here, so that packages for arm64 are built on any computer.
"""

import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

from tests.house.notice import ROOT

HOME: Final = Path("opt/gloc3")
"""Folder of all versions, and of the link `current` to the one that is used."""
SCRIPTS: Final = Path(__file__).parent / "maintainer_scripts"


LIBRARIES: Final = ("libc6 (>= 2.28)", "libgcc-s1", "libstdc++6", "zlib1g")
"""Packages with the libraries that wheels expect of a system (PEP 600)."""


class Target(NamedTuple):
    """A computer with its system."""

    architecture: str
    """As Debian names it."""
    platform: str
    """As uv names it."""
    python: str
    """Its Python, MAJOR.MINOR, which is a package of that name."""
    suffix: str
    """What tells packages of one version for different systems apart."""


TARGETS: Final = tuple(
    Target(architecture, platform, python, suffix)
    for python, suffix in (("3.11", "debian12"), ("3.13", "debian13"))
    for architecture, platform in (("amd64", "x86_64-manylinux_2_28"), ("arm64", "aarch64-manylinux_2_28"))
)
"""Debian 12 and 13, which are also the systems of Raspberry Pi."""


def install_for(target: Target, requirements: Path, wheel: Path, folder: Path) -> None:
    """Installs the locked requirements and the wheel as another computer needs them; only wheels are taken.

    Args:
        target: the computer.
        requirements: locked, with hashes.
        wheel: of GLOC3.
        folder: site-packages.
    """
    where = ["--python-platform", target.platform, "--python-version", target.python, "--target", str(folder)]
    uv = [sys.executable, "-m", "uv", "pip", "install", "--quiet", "--no-build", "--link-mode", "copy", *where]
    subprocess.run([*uv, "--require-hashes", "-r", str(requirements)], check=True)
    name = wheel.name.split("-")
    by_name = ["--no-index", "--find-links", str(wheel.parent), f"{name[0]}=={name[1]}"]
    subprocess.run([*uv, "--no-deps", *by_name], check=True)


def lay(target: Target, version: str, site: Path, tree: Path) -> Path:
    """Lays the files of a package; returns its site-packages.

    Args:
        target: the computer.
        version: of GLOC3.
        site: folder with the installed packages, which is moved.
        tree: the package's root.
    """
    environment = tree / HOME / version
    (environment / "bin").mkdir(parents=True)
    (environment / "pyvenv.cfg").write_text(
        f"home = /usr/bin\ninclude-system-site-packages = false\nversion = {target.python}\n", encoding="ascii"
    )
    python = environment / "bin" / "python"
    python.symlink_to(f"/usr/bin/python{target.python}")
    script = environment / "bin" / "gloc3"
    lines = (f"#!/{HOME}/{version}/bin/python", "import sys", "from gloc3.cli.start import main", "sys.exit(main())")
    script.write_text("\n".join(lines) + "\n", encoding="ascii")
    script.chmod(0o755)
    packages = environment / "lib" / f"python{target.python}" / "site-packages"
    packages.parent.mkdir(parents=True)
    shutil.move(site, packages)
    shutil.rmtree(packages / "bin", ignore_errors=True)
    (packages / ".lock").unlink(missing_ok=True)
    papers = tree / "usr" / "share" / "doc" / f"gloc3-{version}"
    papers.mkdir(parents=True)
    texts = [(ROOT / name).read_text(encoding="utf-8") for name in ("LICENSE", "NOTICE")]
    (papers / "copyright").write_text("\n".join(texts), encoding="utf-8")
    return packages


def pack(target: Target, version: str, tree: Path, folder: Path) -> Path:
    """Makes the package of a tree; returns its file.

    Args:
        target: the computer.
        version: of GLOC3.
        tree: the package's root.
        folder: for the file.
    """
    (tree / "DEBIAN").mkdir()
    (tree / "DEBIAN" / "control").write_text(control(target, version, tree), encoding="utf-8")
    for script in SCRIPTS.iterdir():
        text = script.read_text(encoding="utf-8").replace("@VERSION@", version)
        path = tree / "DEBIAN" / script.name
        path.write_text(text, encoding="utf-8")
        path.chmod(0o755)
    file = folder / f"gloc3-{version}_{version}+{target.suffix}_{target.architecture}.deb"
    options = ["--root-owner-group", "-Zzstd", "--threads-max=1"]
    subprocess.run(["dpkg-deb", *options, "--build", str(tree), str(file)], check=True, stdout=subprocess.DEVNULL)
    return file


def control(target: Target, version: str, tree: Path) -> str:
    """The control file (deb-control(5))."""
    kilobytes = sum(path.lstat().st_size for path in tree.rglob("*")) // 1024
    fields: Mapping[str, str] = {
        "Package": f"gloc3-{version}",
        "Version": f"{version}+{target.suffix}",
        "Architecture": target.architecture,
        "Maintainer": "The GLOC3 authors <gloc3@localhost>",
        "Installed-Size": str(kilobytes),
        "Depends": ", ".join((f"python{target.python}", *LIBRARIES, "passwd")),
        "Recommends": "systemd",
        "Provides": "gloc3",
        "Section": "misc",
        "Priority": "optional",
        "Description": "companion-computer stack and ground station for unmanned vehicles\n"
        " Each version is a package of its own; 'gloc3 update' changes which one a service runs.",
    }
    return "".join(f"{name}: {value}\n" for name, value in fields.items())
