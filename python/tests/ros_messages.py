"""ROS 2's generated Python messages, made from the definitions that rosbags holds of a distribution.

Constructors and setters refuse what those of ``rosidl_generator_py`` refuse: arguments without a name, unknown fields, whole
numbers where floats are, NumPy's numbers where Python's whole numbers are, arrays of another type or size, a ``byte`` that is no
``bytes`` of length 1, submessages of another type. `store.serialize_cdr` then proves that a message is of the definition.
"""

from __future__ import annotations

import array
from collections.abc import Sequence, Set
from types import ModuleType
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

DISTRIBUTIONS = {"humble": Stores.ROS2_HUMBLE, "jazzy": Stores.ROS2_JAZZY}
# Type codes of array.array.
CODES = {
    "float32": "f", "float64": "d", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q",
}


def _check_basic(name: str, kind: str, value: Any) -> None:
    if kind in ("float32", "float64"):
        assert isinstance(value, float), f"The {name!r} field must be of type 'float'"
    elif kind == "bool":
        assert isinstance(value, bool), f"The {name!r} field must be of type 'bool'"
    elif kind == "string":
        assert isinstance(value, str), f"The {name!r} field must be of type 'str'"
    elif kind == "byte":
        assert isinstance(value, bytes) and len(value) == 1, f"The {name!r} field must be of type 'bytes' with length 1"
    else:
        assert isinstance(value, int), f"The {name!r} field must be of type 'int'"
        low, high = np.iinfo(kind).min, np.iinfo(kind).max
        assert low <= value <= high, f"The {name!r} field must be an integer in [{low}, {high}]"


class Definitions:
    """The messages of a distribution."""

    def __init__(self, distribution: str) -> None:
        self.store = get_typestore(DISTRIBUTIONS[distribution])
        self._classes: dict[str, type] = {}

    def __getitem__(self, name: str) -> Any:
        """The class of a message, as ``std_msgs/msg/Header``."""
        if name not in self._classes:
            self._classes[name] = self._made(name)
        return self._classes[name]

    def modules(self, packages: Sequence[str]) -> dict[str, ModuleType]:
        """What ``import PACKAGE.msg`` finds."""
        found: dict[str, ModuleType] = {}
        for package in packages:
            found[package] = ModuleType(package)
            module = found[f"{package}.msg"] = ModuleType(f"{package}.msg")
            # Found on first use: a package has many.
            module.__getattr__ = lambda kind, package=package: self._attribute(package, kind)  # type: ignore[method-assign]
        return found

    def _attribute(self, package: str, kind: str) -> Any:
        name = f"{package}/msg/{kind}"
        if name not in self.store.fielddefs:
            raise AttributeError(name)
        return self[name]

    def _made(self, name: str) -> type:
        constants, definitions = self.store.fielddefs[name]
        fields = {field: self._property(field, definition) for field, definition in definitions}

        def construct(message: Any, /, **values: Any) -> None:
            unknown = sorted(set(values) - set(fields))
            assert not unknown, f"Invalid arguments passed to constructor: {', '.join(unknown)}"
            for field, definition in definitions:
                setattr(message, field, self._initial(definition, values[field]) if field in values else self._default(definition))

        def equals(message: Any, other: Any) -> bool:
            return type(message) is type(other) and all(
                np.array_equal(getattr(message, field), getattr(other, field)) for field in fields
            )

        def words(message: Any) -> str:
            return f"{name}({', '.join(f'{field}={getattr(message, field)!r}' for field in fields)})"

        content = {
            "__slots__": tuple(f"_{field}" for field in fields), "__init__": construct, "__eq__": equals, "__hash__": None,
            "__repr__": words, "kind": name, "fields": dict(definitions), **fields,
        }
        for constant, kind, value in constants:
            content[constant] = bytes([value]) if kind == "byte" else value
        return type(name.rpartition("/")[2], (), content)

    def _default(self, definition: Any) -> Any:
        node, what = definition
        if node == Nodetype.BASE:
            kind = what[0]
            return {"string": "", "bool": False, "byte": b"\0"}.get(kind, 0.0 if kind.startswith("float") else 0)
        if node == Nodetype.NAME:
            return self[what]()
        (inner, inside), size = what
        if node == Nodetype.ARRAY:
            return np.zeros(size, inside[0])
        return array.array(CODES[inside[0]]) if inner == Nodetype.BASE and inside[0] in CODES else []

    def _initial(self, definition: Any, value: Any) -> Any:
        """What the constructor makes of an argument before it is set."""
        node, what = definition
        if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (inner, inside), size = what
            if inner == Nodetype.BASE and inside[0] in CODES:
                if node == Nodetype.SEQUENCE:
                    return array.array(CODES[inside[0]], value)
                value = np.array(value, dtype=inside[0])
                assert value.shape == (size,)
        return value

    def _property(self, field: str, definition: Any) -> property:
        def get(message: Any) -> Any:
            return getattr(message, f"_{field}")

        def put(message: Any, value: Any) -> None:
            object.__setattr__(message, f"_{field}", self._checked(field, definition, value))

        return property(get, put)

    def _checked(self, field: str, definition: Any, value: Any) -> Any:
        node, what = definition
        if node == Nodetype.BASE:
            _check_basic(field, what[0], value)
            return value
        if node == Nodetype.NAME:
            assert isinstance(value, self[what]), f"The {field!r} field must be a sub message of type {what}"
            return value
        (inner, inside), size = what
        kind = inside[0] if inner == Nodetype.BASE else ""
        if node == Nodetype.ARRAY and isinstance(value, np.ndarray):
            assert value.dtype == np.dtype(kind), f"The {field!r} numpy.ndarray() must have the dtype of {kind}"
            assert value.size == size, f"The {field!r} numpy.ndarray() must have a size of {size}"
            return value
        if node == Nodetype.SEQUENCE and kind in CODES and isinstance(value, array.array):
            assert value.typecode == CODES[kind], f"The {field!r} array.array() must have the type code {CODES[kind]}"
            return value
        is_sequence = isinstance(value, (Sequence, Set)) and not isinstance(value, str)
        assert is_sequence, f"The {field!r} field must be a set or sequence, found {type(value).__name__}"
        if node == Nodetype.ARRAY:
            assert len(value) == size, f"The {field!r} field must have length {size}"
        elif size:
            assert len(value) <= size, f"The {field!r} field must have length <= {size}"
        for one in value:
            if kind:
                _check_basic(field, kind, one)
            else:
                assert isinstance(one, self[inside]), f"The {field!r} field must be of sub messages {inside}"
        if kind in CODES:
            return np.array(value, kind) if node == Nodetype.ARRAY else array.array(CODES[kind], value)
        return value

    def serialized(self, message: Any) -> bytes:
        """As it goes over the wire."""
        return bytes(self.store.serialize_cdr(self.plain(message), message.kind))

    def received(self, data: bytes, kind: str) -> Any:
        """A message as it comes from the wire."""
        return self.of(self.store.deserialize_cdr(data, kind))

    def plain(self, message: Any) -> Any:
        """The message as rosbags has it."""

        def value(definition: Any, one: Any) -> Any:
            node, what = definition
            if node == Nodetype.NAME:
                return self.plain(one)
            if node == Nodetype.BASE:
                return one[0] if what[0] == "byte" else one
            (inner, inside), _ = what
            return [self.plain(each) for each in one] if inner == Nodetype.NAME else np.array(one, inside[0])

        fields = {field: value(definition, getattr(message, field)) for field, definition in message.fields.items()}
        return self.store.types[message.kind](**fields)

    def of(self, plain: Any) -> Any:
        """The message of one that rosbags has read."""

        def value(definition: Any, one: Any) -> Any:
            node, what = definition
            if node == Nodetype.NAME:
                return self.of(one)
            if node == Nodetype.BASE:
                return bytes([one]) if what[0] == "byte" else one
            (inner, inside), _ = what
            if inner == Nodetype.NAME:
                return [self.of(each) for each in one]
            if node == Nodetype.ARRAY:
                return np.array(one, inside[0])
            return array.array(CODES[inside[0]], np.asarray(one).tobytes()) if inside[0] in CODES else list(one)

        kind = self[plain.__msgtype__]
        return kind(**{field: value(definition, getattr(plain, field)) for field, definition in kind.fields.items()})
