"""A stand-in for `launch` and `launch_ros`, as much of them as our launch files use.

What an action takes is checked by its arguments' names. Substitutions are performed, values without a type are read as YAML, as
`launch_ros` does, an argument without a default has to be given, and what is included is launched with its own arguments.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import Any

from ruamel.yaml import YAML


def read_yaml(text: str | Path) -> Any:
    return YAML(typ="safe", pure=True).load(text)


class Substitution:
    def perform(self, launch: Launch) -> str:
        raise NotImplementedError


@dataclass
class LaunchConfiguration(Substitution):
    name: str

    def perform(self, launch: Launch) -> str:
        return launch.configurations[self.name]


@dataclass
class PathJoinSubstitution(Substitution):
    parts: Sequence[Any]

    def perform(self, launch: Launch) -> str:
        return str(Path(*(launch.words(part) for part in self.parts)))


@dataclass
class FindPackageShare(Substitution):
    package: str

    def perform(self, launch: Launch) -> str:
        assert self.package == launch.share.name, f"package '{self.package}' not found"
        return str(launch.share)


@dataclass
class ParameterValue:
    value: Any
    value_type: type | None = field(default=None, kw_only=True)

    def perform(self, launch: Launch) -> Any:
        words = launch.words(self.value)
        if self.value_type is str:
            return words
        found = read_yaml(words)
        assert self.value_type in (None, type(found)), f"expected {self.value_type}, found {words!r}"
        return found


@dataclass
class IfCondition:
    predicate_expression: Any

    def holds(self, launch: Launch) -> bool:
        words = launch.words(self.predicate_expression)
        assert words.lower() in ("true", "false", "1", "0"), f"InvalidConditionExpressionError: {words!r}"
        return words.lower() in ("true", "1")


@dataclass
class DeclareLaunchArgument:
    name: str
    default_value: Any = field(default=None, kw_only=True)
    description: str = field(default="", kw_only=True)

    def run(self, launch: Launch) -> None:
        assert self.description
        if self.name not in launch.configurations:
            if self.default_value is None:
                raise RuntimeError(f"Included launch description missing required argument '{self.name}'")
            launch.configurations[self.name] = launch.words(self.default_value)


@dataclass(kw_only=True)
class Node:
    executable: Any
    package: Any
    name: Any = None
    namespace: Any = None
    parameters: Sequence[Any] = ()
    remappings: Sequence[Any] = ()
    output: Any = None
    condition: Any = None

    def run(self, launch: Launch) -> None:
        if self.condition is None or self.condition.holds(launch):
            launch.started.append(launch.described(self))


@dataclass(kw_only=True)
class ComposableNode:
    package: Any
    plugin: Any
    name: Any = None
    namespace: Any = None
    parameters: Sequence[Any] = ()
    remappings: Sequence[Any] = ()
    extra_arguments: Sequence[Any] = ()


@dataclass(kw_only=True)
class ComposableNodeContainer(Node):
    # Both are required of a container.
    name: Any
    namespace: Any
    composable_node_descriptions: Sequence[ComposableNode] = ()

    def run(self, launch: Launch) -> None:
        super().run(launch)
        launch.loaded += map(launch.described, self.composable_node_descriptions)


@dataclass(kw_only=True)
class LoadComposableNodes:
    composable_node_descriptions: Sequence[ComposableNode]
    target_container: Any
    condition: Any = None

    def run(self, launch: Launch) -> None:
        if self.condition is None or self.condition.holds(launch):
            assert isinstance(self.target_container, ComposableNodeContainer)
            launch.loaded += map(launch.described, self.composable_node_descriptions)


@dataclass
class PythonLaunchDescriptionSource:
    path: Any


@dataclass
class IncludeLaunchDescription:
    source: PythonLaunchDescriptionSource
    launch_arguments: Any = field(default=(), kw_only=True)

    def run(self, launch: Launch) -> None:
        for name, value in self.launch_arguments:
            launch.configurations[name] = launch.words(value)
        launch.run(launch.words(self.source.path))


@dataclass
class LaunchDescription:
    entities: Sequence[Any]


@dataclass
class Launch:
    """A launch, and what it started."""

    share: Path
    """The package's folder, of the package's name."""
    configurations: dict[str, str] = field(default_factory=dict)
    started: list[dict[str, Any]] = field(default_factory=list)
    loaded: list[dict[str, Any]] = field(default_factory=list)

    def words(self, value: Any) -> str:
        if isinstance(value, str):
            return value
        if isinstance(value, Substitution):
            return value.perform(self)
        return "".join(map(self.words, value))

    def described(self, node: Any) -> dict[str, Any]:
        found: dict[str, Any] = {
            name: self.words(getattr(node, name)) for name in ("package", "name", "namespace") if getattr(node, name) is not None
        }
        found["what"] = self.words(getattr(node, "plugin", None) or node.executable)
        found["parameters"], found["files"] = {}, []
        for given in node.parameters:
            if isinstance(given, dict):
                found["parameters"].update({name: self._value(value) for name, value in given.items()})
            else:
                path = Path(self.words(given))
                found["files"].append(path)
                if path.exists():
                    found["parameters"].update(read_yaml(path)["/**"]["ros__parameters"])
        found["remappings"] = {self.words(old): self.words(new) for old, new in node.remappings}
        return found

    def _value(self, value: Any) -> Any:
        if isinstance(value, ParameterValue):
            return value.perform(self)
        return read_yaml(self.words(value)) if isinstance(value, (Substitution, list, tuple)) else value

    def run(self, path: str | Path) -> None:
        spec = importlib.util.spec_from_file_location("launched", path)
        assert spec is not None and spec.loader is not None
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        for entity in module.generate_launch_description().entities:
            entity.run(self)


def install(patch: Any) -> None:
    """Puts the modules where launch files import them from."""
    contents: dict[str, list[type]] = {
        "launch": [LaunchDescription],
        "launch.actions": [DeclareLaunchArgument, IncludeLaunchDescription],
        "launch.conditions": [IfCondition],
        "launch.launch_description_sources": [PythonLaunchDescriptionSource],
        "launch.substitutions": [LaunchConfiguration, PathJoinSubstitution],
        "launch_ros": [],
        "launch_ros.actions": [ComposableNodeContainer, LoadComposableNodes, Node],
        "launch_ros.descriptions": [ComposableNode],
        "launch_ros.parameter_descriptions": [ParameterValue],
        "launch_ros.substitutions": [FindPackageShare],
    }
    for name, kinds in contents.items():
        module = ModuleType(name)
        vars(module).update({kind.__name__: kind for kind in kinds})
        patch.setitem(sys.modules, name, module)
