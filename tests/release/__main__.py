"""`make release`: everything that is published of a version, in one folder."""

import argparse
import shutil
import sys
from pathlib import Path

from tests.house.notice import ROOT
from tests.release.build import release

parser = argparse.ArgumentParser(prog="python -m tests.release", description=__doc__)
parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "dist", help="where the version's folder goes")
parser.add_argument("--key", type=Path, help="private key of OpenSSH that signs the checksums")
parser.add_argument("--no-debian", action="store_true", help="leave the Debian packages out: they need the network")
given = parser.parse_args()
if shutil.which("dpkg-deb") is None and not given.no_debian:
    sys.exit("dpkg-deb is not installed: it makes the Debian packages (--no-debian leaves them out)")
try:
    release(given.folder, key=given.key, with_debian=not given.no_debian, report=print)
except ValueError as error:
    sys.exit(str(error))
