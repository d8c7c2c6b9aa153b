"""OpenCV's XML as a document with places, like YAML: without entities, which a short file can grow a huge one from."""

from typing import Any, Final
from xml.parsers import expat

from gloc3.documents.document import MAX_BYTES, Document
from gloc3.documents.yaml_nodes import MAX_DEPTH, MAX_NODES, Node
from gloc3.errors import Finding, InputError

MATRIX: Final = "opencv-matrix"


class _Element:
    """An element that is being read."""

    def __init__(self, name: str, line: int, column: int) -> None:
        self.name, self.line, self.column = name, line, column
        self.text: list[str] = []
        self.text_at: tuple[int, int] | None = None
        self.children: list[tuple[str, Node]] = []


class _Builder:
    """Takes what the parser finds."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.root: Node | None = None
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


def _mapping(element: _Element) -> Node:
    node = Node({}, element.line, element.column)
    for name, child in element.children:
        if name not in node.children:
            node.value[name] = child.value
            node.children[name] = child
            node.key_places[name] = (child.line, child.column)
    return node


def _plain(element: _Element) -> Node:
    """A number, several, or text; `data` is always several."""
    line, column = element.text_at or (element.line, element.column)
    words = "".join(element.text).split()
    values = [_value(word) for word in words]
    is_list = element.name == "data" or (len(values) > 1 and all(isinstance(value, int | float) for value in values))
    if not is_list:
        return Node(values[0] if len(values) == 1 else " ".join(words), line, column)
    node = Node(values, line, column)
    node.children = {index: Node(value, line, column) for index, value in enumerate(values)}
    return node


def _value(word: str) -> int | float | str:
    for kind in (int, float):
        try:
            return kind(word)
        except ValueError:
            continue
    return word
