"""Rooms: each says what it is and names its face, other rooms import faces, and the documents list them all."""

import ast
import re
from collections.abc import Iterator, Mapping

import pytest
from tests.house import rooms, where
from tests.house.measure import Measures, Module, find_circles, imports_of, measure, read_modules, room_names

ROOMS = room_names(where.ROOT)
LARGEST = 20
"""Modules of a room, at most."""


def modules() -> Mapping[str, Module]:
    return read_modules(where.ROOT)


@pytest.fixture(scope="module")
def measures() -> Measures:
    return measure(where.ROOT)


def room_of(name: str) -> str:
    return name if name in ROOMS else name.rpartition(".")[0]


def modules_in(room: str) -> list[str]:
    return [name for name in modules() if name.rpartition(".")[0] == room and name not in ROOMS]


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_says_what_it_is_and_names_a_face_that_is_there(room: str) -> None:
    package = modules()[room]
    text = ast.get_docstring(package.tree) or ""
    first, _, rest = text.partition("\n")
    assert first.endswith(".")
    if modules_in(room):
        assert rest.strip(), "a second sentence says what of it others use"
    names = {name.rpartition(".")[2] for name in modules_in(room)}
    assert set(where.face_of(package)) <= names | defined_in(package)


def defined_in(module: Module) -> set[str]:
    """The names that a module defines or imports at its top."""
    found = set[str]()
    for node in module.tree.body:
        if isinstance(node, ast.ImportFrom):
            found |= {alias.asname or alias.name for alias in node.names}
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            found.add(node.target.id)
    return found


def test_other_rooms_import_faces() -> None:
    assert sorted(set(_behind_faces())) == []


def _behind_faces() -> Iterator[str]:
    for name, module in modules().items():
        for other in imports_of(module, modules()):
            room, _, own = other.rpartition(".")
            if other not in ROOMS and room != room_of(name) and own not in where.face_of(modules()[room]):
                yield f"{name} imports {other}"


def test_a_face_holds_nothing_that_no_other_room_imports() -> None:
    used = {
        other
        for name, module in modules().items()
        for other in imports_of(module, modules())
        if room_of(other) != room_of(name)
    }
    unused = {
        f"{room}.{name}"
        for room in ROOMS
        for name in where.face_of(modules()[room])
        if f"{room}.{name}" in modules() and f"{room}.{name}" not in used
    }
    assert unused == set()


def test_no_room_is_a_corridor() -> None:
    assert {room: len(modules_in(room)) for room in ROOMS if len(modules_in(room)) > LARGEST} == {}


def test_no_modules_import_each_other(measures: Measures) -> None:
    assert measures.circles == ()


def test_circles_are_found() -> None:
    arrows = {"a": {"b"}, "b": {"c"}, "c": {"a", "d"}, "d": set[str](), "e": {"a"}}
    assert find_circles(arrows) == [("a", "b", "c")]


def test_no_two_public_classes_of_one_package_share_a_name(measures: Measures) -> None:
    assert measures.reused_in_a_package == ()
    assert len(measures.reused_class_names) <= 15


def test_constructors_and_parameter_lists_stay_short(measures: Measures) -> None:
    assert measures.longest_constructor[1] <= 40, measures.longest_constructor
    assert len(measures.many_parameters) <= 10, measures.many_parameters


def test_the_page_of_rooms_is_up_to_date() -> None:
    assert where.PAGE.read_text(encoding="utf-8") == where.page(), "run `make docs`"


def test_the_picture_of_rooms_is_up_to_date() -> None:
    text = rooms.PICTURE.read_text(encoding="utf-8")
    assert text == rooms.svg(), "run `make docs`"
    boxes = re.findall(r'<rect x="(\d+)" y="\d+" width="(\d+)" height="\d+" rx="6"', text)
    chips = re.findall(r'<rect x="(\d+)" y="\d+" width="(\d+)" height="\d+" rx="4"', text)
    farthest = [max(int(x) + int(width) for x, width in found) for found in (boxes, chips)]
    assert farthest[0] == farthest[1] + rooms.GAP, "the rooms are inside their packages"
