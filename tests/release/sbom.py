"""The software bill of materials: a CycloneDX file of all that an installation brings, with licences."""

import tomllib
from collections.abc import Iterable
from importlib.metadata import version
from typing import Final

from cyclonedx.contrib.license.factories import LicenseFactory
from cyclonedx.model.bom import Bom
from cyclonedx.model.component import Component, ComponentType
from cyclonedx.output.json import JsonV1Dot6
from packageurl import PackageURL
from tests.house.notice import ROOT, licence_of
from tests.release.closure import closure

PROJECT: Final = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def bill(extras: Iterable[str] = tuple(PROJECT["optional-dependencies"])) -> str:
    """The bill of the packages that are installed here, as JSON.

    Args:
        extras: what of GLOC3 is billed; the default is all.

    Raises:
        ValueError: the metadata of a package names no licence.
    """
    needs = closure(extras)
    components = {name: _component(name) for name in needs}
    bom = Bom(components=[one for name, one in components.items() if name != "gloc3"])
    bom.metadata.component = components["gloc3"]
    for name, others in needs.items():
        bom.register_dependency(components[name], [components[one] for one in others])
    return JsonV1Dot6(bom).output_as_string(indent=2)


def _component(name: str) -> Component:
    found = version(name)
    url = PackageURL("pypi", None, name, found)
    return Component(
        name=name,
        version=found,
        type=ComponentType.APPLICATION if name == "gloc3" else ComponentType.LIBRARY,
        licenses=[LicenseFactory().make_from_string(licence_of(name))],
        purl=url,
        bom_ref=str(url),
    )
