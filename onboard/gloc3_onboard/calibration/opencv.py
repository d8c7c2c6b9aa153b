"""OpenCV's FileStorage, YAML and XML, as `calibrateCamera` samples, ROS's camera calibrator and many tools write it.

A file holds one camera (`camera_matrix`, `distortion_coefficients`; or `K`, `D`) or the two of a stereo pair (`M1`,
`D1`, `M2`, `D2`, and with `R`, `T` the pose of the right one relative to the left). YAML has a first line `%YAML:1.0`
and tags unknown to YAML; both are blanked before reading, so that every position stays the same.
"""

import re
from collections.abc import Sequence
from typing import Any, Final
from xml.parsers import expat

from gloc3.camera.model import CameraModel, Lens
from gloc3.documents.document import MAX_BYTES, Document, Where, parse
from gloc3.documents.yaml_nodes import MAX_DEPTH, MAX_NODES, YamlNode
from gloc3.errors import Finding, InputError
from gloc3_onboard.calibration.lens import IN_PLACE, WrittenLens, lens_model, size_of
from gloc3_onboard.calibration.mounting import Transform, quaternion_of, transform_problem
from gloc3_onboard.calibration.numbers import Values

MATRICES: Final = ("camera_matrix", "cameraMatrix", "Camera_Matrix", "intrinsic", "K")
COEFFICIENTS: Final = (
    "distortion_coefficients",
    "Distortion_Coefficients",
    "distCoeffs",
    "dist_coeffs",
    "distCoeff",
    "dist_coeff",
    "D",
)
WIDTHS: Final = ("image_width", "image_Width", "imageWidth", "width")
HEIGHTS: Final = ("image_height", "image_Height", "imageHeight", "height")
SIZES: Final = ("image_size", "imageSize", "resolution")
FISHEYE: Final = ("fisheye_model", "fisheye")
MODELS: Final[dict[str, Lens]] = {
    "plumb_bob": Lens.RADTAN,
    "radtan": Lens.RADTAN,
    "pinhole": Lens.RADTAN,
    "fisheye": Lens.EQUIDISTANT,
    "equidistant": Lens.EQUIDISTANT,
}
"""`distortion_model`, as ROS writes it."""
PAIR: Final = (("left", "1"), ("right", "2"))
_UNKNOWN_TO_YAML: Final = re.compile(r"^%YAML[^\n]*|!!opencv-[a-z-]+|!!python/[a-z]+", re.MULTILINE)


def looks_like_opencv(text: str) -> bool:
    """Whether the text is perhaps of OpenCV."""
    return "opencv" in text or any(re.search(rf"^\s*{name}\s*:", text, re.MULTILINE) for name in (*MATRICES, "M1"))


def read_opencv(text: str, file: str) -> tuple[dict[str, CameraModel], Values]:
    """The cameras of a file by name, *camera*, or *left* and *right*; and the findings.

    Raises:
        InputError: the text is neither YAML nor XML.
    """
    values = Values(_document(text, file))
    if values.first((), ("M1", "cameraMatrix1", "K1")):
        return _pair(values), values
    model = _camera(values, "", "", IN_PLACE)
    return ({"camera": model} if model is not None else {}), values


def _document(text: str, file: str) -> Document:
    if text.lstrip("\ufeff \t\r\n").startswith("<"):
        return parse_xml(text, file)
    return parse(_UNKNOWN_TO_YAML.sub(lambda found: " " * len(found[0]), text), file)


def _pair(values: Values) -> dict[str, CameraModel]:
    """Both cameras; the right one where `R` and `T` put it: `p_right = R @ p_left + T`."""
    mounts = {"left": IN_PLACE, "right": IN_PLACE}
    if values.value(("R",)) is not None and values.value(("T",)) is not None:
        rotation = values.matrix(("R",), 3, 3, "R")
        shift = _numbers(values, ("T",), (3,), "T")
        problem = transform_problem(rotation) if rotation is not None else ""
        if problem:
            values.wrong(("R",), f"R: {problem}")
        elif rotation is not None and shift is not None:
            right_from_left = Transform((shift[0], shift[1], shift[2]), quaternion_of(rotation))
            mounts["right"] = IN_PLACE.then(right_from_left.inverse())
    found = {name: _camera(values, number, name, mounts[name]) for name, number in PAIR}
    return {name: model for name, model in found.items() if model is not None}


def _camera(values: Values, number: str, name: str, mount: Transform) -> CameraModel | None:
    matrices = ("M1", "cameraMatrix1", "K1") if number == "1" else ("M2", "cameraMatrix2", "K2")
    coefficients = ("D1", "distCoeffs1") if number == "1" else ("D2", "distCoeffs2")
    at = values.first((), matrices if number else MATRICES)
    lens_at = values.first((), coefficients if number else COEFFICIENTS)
    size = _size(values)
    if at is None:
        values.missing((), matrices[0] if number else MATRICES[0])
        return None
    matrix = values.matrix(at, 3, 3, f"the camera matrix {name}".strip())
    given = _numbers(values, lens_at, (4, 5, 8, 12, 14), "distortion coefficients") if lens_at is not None else []
    if matrix is None or given is None or size is None:
        return None
    if abs(matrix[0][1]) > 1e-6 * matrix[0][0] or matrix[2] != [0.0, 0.0, 1.0]:
        values.wrong(at, "this is not a camera matrix", "fx, 0, cx; 0, fy, cy; 0, 0, 1; skew is not supported")
        return None
    return lens_model(
        values,
        at,
        WrittenLens(
            size,
            (matrix[0][0], matrix[1][1], matrix[0][2], matrix[1][2]),
            _lens(values) if given else Lens.PINHOLE,
            given,
            lens_at or at,
        ),
        mount,
    )


def _numbers(values: Values, where: Where, counts: Sequence[int], what: str) -> list[float] | None:
    """A row or a column: an OpenCV matrix, or a list."""
    value = values.value(where)
    if not isinstance(value, dict):
        return values.numbers(where, counts, what)
    shape = (value.get("rows"), value.get("cols"))
    found = values.numbers((*where, "data"), counts, what)
    if found is not None and sorted(map(str, shape)) != sorted(("1", str(len(found)))):
        values.wrong(where, f"{what}: {shape[0]} by {shape[1]} do not hold {len(found)} numbers")
        return None
    return found


def _size(values: Values) -> tuple[int, int] | None:
    width, height = values.first((), WIDTHS), values.first((), HEIGHTS)
    if width is not None and height is not None:
        return size_of(values, width, (values.value(width), values.value(height)))
    size = values.first((), SIZES)
    listed = values.value(size) if size is not None else None
    if isinstance(listed, list):
        return size_of(values, size or (), listed)
    values.missing((), WIDTHS[0])
    return None


def _lens(values: Values) -> Lens:
    at = values.first((), FISHEYE)
    if at is not None:
        return Lens.EQUIDISTANT if values.value(at) not in (0, False, None) else Lens.RADTAN
    name = values.value(("distortion_model",))
    if name is None or name in MODELS:
        return MODELS.get(str(name), Lens.RADTAN)
    values.wrong(("distortion_model",), f"the lens {name!r} is not supported", f"known: {', '.join(MODELS)}")
    return Lens.RADTAN


MATRIX: Final = "opencv-matrix"


class _Element:
    """An element that is being read."""

    def __init__(self, name: str, line: int, column: int) -> None:
        self.name, self.line, self.column = name, line, column
        self.text: list[str] = []
        self.text_at: tuple[int, int] | None = None
        self.children: list[tuple[str, YamlNode]] = []


class _Builder:
    """Receives the parser's results."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.root: YamlNode | None = None
        self._stack: list[_Element] = []
        self._nodes = 0
        self.parser = expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._begin
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._characters

    def fail(self, message: str, hint: str = "") -> InputError:
        line, column = self._place()
        return InputError([Finding(file=self.file, line=line, column=column, message=message, hint=hint)])

    def _place(self) -> tuple[int, int]:
        return self.parser.CurrentLineNumber, self.parser.CurrentColumnNumber + 1

    def _doctype(self, *_: Any) -> None:
        raise self.fail("a document type is declared", "OpenCV writes none")

    def _begin(self, name: str, _attributes: dict[str, str]) -> None:
        self._nodes += 1
        if len(self._stack) >= MAX_DEPTH or self._nodes > MAX_NODES:
            raise self.fail("there is too much in the file")
        self._stack.append(_Element(name, *self._place()))

    def _characters(self, text: str) -> None:
        element = self._stack[-1]
        if element.text_at is None and text.strip():
            element.text_at = self._place()
        element.text.append(text)

    def _end(self, _name: str) -> None:
        element = self._stack.pop()
        node = _mapping(element) if element.children else _plain(element)
        if self._stack:
            self._stack[-1].children.append((element.name, node))
        else:
            self.root = node


def parse_xml(text: str, file: str) -> Document:
    """Reads OpenCV's XML: elements are keys, numbers between spaces are lists.

    Raises:
        InputError: it is no XML, or has more in it than such a file has.
    """
    if len(text) > MAX_BYTES:
        raise InputError([Finding(file=file, message="too much for a calibration")])
    builder = _Builder(file)
    try:
        builder.parser.Parse(text.encode("utf-8", "replace"), True)
    except expat.ExpatError as error:
        words = expat.errors.messages[error.code]
        finding = Finding(file=file, line=error.lineno, column=error.offset + 1, message=f"not XML: {words}")
        raise InputError([finding]) from error
    if builder.root is None or not isinstance(builder.root.value, dict):
        raise InputError([Finding(file=file, message="nothing is in it")])
    return Document(file, builder.root)


def _mapping(element: _Element) -> YamlNode:
    node = YamlNode({}, element.line, element.column)
    for name, child in element.children:
        if name not in node.children:
            node.value[name] = child.value
            node.children[name] = child
            node.key_places[name] = (child.line, child.column)
    return node


def _plain(element: _Element) -> YamlNode:
    """A number, several, or text; `data` is always several."""
    line, column = element.text_at or (element.line, element.column)
    words = "".join(element.text).split()
    values = [_value(word) for word in words]
    is_list = element.name == "data" or (len(values) > 1 and all(isinstance(value, int | float) for value in values))
    if not is_list:
        return YamlNode(values[0] if len(values) == 1 else " ".join(words), line, column)
    node = YamlNode(values, line, column)
    node.children = {index: YamlNode(value, line, column) for index, value in enumerate(values)}
    return node


def _value(word: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word
