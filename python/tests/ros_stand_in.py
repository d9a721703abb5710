"""A stand-in for `rclpy`, with the messages that rosbags defines for a distribution.

It refuses what `rclpy` refuses, as its source has it (Humble to Jazzy): parameters of another type, out of range, not declared
or read only; descriptors of other shape; profiles built otherwise; messages of another type or content; two levels of severity,
or two throttles, at one place of the code; attributes that are `Node`'s own. What is published is serialized by its definition
and read again. Names are resolved with namespace and remappings, and what is sent on a topic reaches a subscription where their
qualities of service agree.
"""

from __future__ import annotations

import array
import enum
import inspect
import math
import sys
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from types import ModuleType, SimpleNamespace
from typing import Any

from ros_messages import Definitions

PACKAGES = (
    "builtin_interfaces", "std_msgs", "geometry_msgs", "sensor_msgs", "diagnostic_msgs", "rcl_interfaces",
)


class HistoryPolicy(enum.IntEnum):
    SYSTEM_DEFAULT, KEEP_LAST, KEEP_ALL, UNKNOWN = range(4)


class ReliabilityPolicy(enum.IntEnum):
    SYSTEM_DEFAULT, RELIABLE, BEST_EFFORT, UNKNOWN = range(4)


class DurabilityPolicy(enum.IntEnum):
    SYSTEM_DEFAULT, TRANSIENT_LOCAL, VOLATILE, UNKNOWN = range(4)


class QoSProfile:
    """The default is reliable and volatile."""

    def __init__(self, **kwargs: Any) -> None:
        assert set(kwargs) <= {"history", "depth", "reliability", "durability"}, f"Invalid arguments: {kwargs}"
        if "history" not in kwargs and "depth" not in kwargs:
            raise ValueError("History and/or depth settings are required.")
        self.history = HistoryPolicy(kwargs.get("history", HistoryPolicy.KEEP_LAST))
        if self.history == HistoryPolicy.KEEP_LAST and "depth" not in kwargs:
            raise ValueError("History set to KEEP_LAST without a depth setting.")
        self.depth = kwargs.get("depth", 10)
        assert type(self.depth) is int
        self.reliability = ReliabilityPolicy(kwargs.get("reliability", ReliabilityPolicy.RELIABLE))
        self.durability = DurabilityPolicy(kwargs.get("durability", DurabilityPolicy.VOLATILE))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, QoSProfile) and vars(self) == vars(other)

    __hash__ = None  # type: ignore[assignment]


def sensor_data() -> QoSProfile:
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)


def agree(offered: QoSProfile, requested: QoSProfile) -> bool:
    """Whether a publisher's messages reach a subscription."""
    reliable, kept = ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL
    lacks = requested.reliability == reliable and offered.reliability != reliable
    return not lacks and not (requested.durability == kept and offered.durability != kept)


class QoSOverridingOptions:
    def __init__(self, policies: Iterable[str]) -> None:
        self.policies = tuple(policies)

    @classmethod
    def with_default_policies(cls) -> QoSOverridingOptions:
        return cls(("history", "depth", "reliability"))


class ParameterException(Exception):
    def __init__(self, words: str, name: str) -> None:
        super().__init__(f"{words}: {name}")


class ExternalShutdownException(Exception):
    pass


class Parameter:
    class Type(enum.IntEnum):
        NOT_SET, BOOL, INTEGER, DOUBLE, STRING, BYTE_ARRAY, BOOL_ARRAY, INTEGER_ARRAY, DOUBLE_ARRAY, STRING_ARRAY = range(10)

        @classmethod
        def from_parameter_value(cls, value: Any) -> Parameter.Type:
            single = {type(None): cls.NOT_SET, bool: cls.BOOL, int: cls.INTEGER, float: cls.DOUBLE, str: cls.STRING}
            if type(value) in single:
                return single[type(value)]
            if isinstance(value, (list, tuple, array.array)):
                # Nothing is all of any type: the first wins.
                for kind, found in (
                    (bytes, cls.BYTE_ARRAY), (bool, cls.BOOL_ARRAY), (int, cls.INTEGER_ARRAY), (float, cls.DOUBLE_ARRAY),
                    (str, cls.STRING_ARRAY),
                ):
                    if all(type(one) is kind for one in value):
                        return found
            raise TypeError(f"The given value is not one of the allowed types '{value}'.")

    def __init__(self, name: str, type_: Any = None, value: Any = None) -> None:
        found = self.Type.from_parameter_value(value)
        if type_ not in (None, found):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self.name, self.type_ = name, found
        # As it comes out of a message.
        self.value = array.array("d", value) if found == self.Type.DOUBLE_ARRAY else value


class Logger:
    """Throttles by the world's time."""

    FILTERS = ("throttle_duration_sec", "throttle_time_source_type", "skip_first", "once")

    def __init__(self, world: World) -> None:
        self.world = world
        self.contexts: dict[Any, dict[str, Any]] = {}

    def _log(self, level: str, line: Any, filters: dict[str, Any]) -> bool:
        assert isinstance(line, str), f"expected words to log, found {line!r}"
        assert set(filters) <= set(self.FILTERS), f"not a logging option: {filters}"
        caller = inspect.currentframe().f_back.f_back  # type: ignore[union-attr]
        place = (caller.f_code.co_filename, caller.f_lineno, caller.f_lasti)  # type: ignore[union-attr]
        context = self.contexts.setdefault(place, {"level": level, "filters": dict(filters), "last_s": -math.inf})
        if context["level"] != level:
            raise ValueError("Logger severity cannot be changed between calls.")
        if context["filters"] != filters:
            raise ValueError("Logging filter parameters cannot be changed between calls.")
        if self.world.steady_s < context["last_s"] + filters.get("throttle_duration_sec", 0.0):
            return False
        context["last_s"] = self.world.steady_s
        self.world.lines.append((level, line))
        return True

    def debug(self, line: str, **filters: Any) -> bool:
        return self._log("debug", line, filters)

    def info(self, line: str, **filters: Any) -> bool:
        return self._log("info", line, filters)

    def warning(self, line: str, **filters: Any) -> bool:
        return self._log("warning", line, filters)

    def error(self, line: str, **filters: Any) -> bool:
        return self._log("error", line, filters)

    def fatal(self, line: str, **filters: Any) -> bool:
        return self._log("fatal", line, filters)


class ClockType(enum.IntEnum):
    ROS_TIME, SYSTEM_TIME, STEADY_TIME = range(1, 4)


@dataclass
class Publisher:
    node: Node
    kind: type
    topic: str
    qos: QoSProfile
    sent: list[Any] = field(default_factory=list)
    listeners: int = 0

    def get_subscription_count(self) -> int:
        return self.listeners

    def publish(self, message: Any) -> None:
        if type(message) is not self.kind:
            raise TypeError(f"Expected {self.kind}, got {type(message)}")
        assert not self.node.is_destroyed, "publisher was destroyed"
        definitions = self.node.world.definitions
        received = definitions.received(definitions.serialized(message), message.kind)
        assert 0 <= received.header.stamp.nanosec < 10**9
        self.sent.append(received)


@dataclass
class Subscription:
    kind: type
    topic: str
    callback: Callable[[Any], None]
    qos: QoSProfile


class Node:
    """Its own attributes, as `rclpy` has them, are not those of what is made of it."""

    OWN = (
        "_context", "_parameters", "_publishers", "_subscriptions", "_clients", "_services", "_timers", "_guards", "_logger",
        "_default_callback_group", "_pre_set_parameters_callbacks", "_on_set_parameters_callbacks", "_descriptors", "_clock",
        "_post_set_parameters_callbacks", "_rate_group", "_allow_undeclared_parameters", "_parameter_overrides", "_time_source",
        "_parameter_event_publisher", "_parameter_service", "_logger_service", "_type_description_service", "_handle",
        "_executor", "publishers", "subscriptions", "timers", "clients", "services", "context", "handle", "executor",
    )
    world: World

    def __init__(self, node_name: str, *, namespace: str | None = None, parameter_overrides: Any = None) -> None:
        assert self.world.is_initialized, "rclpy.init() has not been called."
        self._name, self._namespace = node_name, f"/{(namespace or self.world.namespace).strip('/')}"
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        overrides = {name: Parameter(name, value=value) for name, value in self.world.overrides.items()}
        self._parameter_overrides = {**overrides, **{p.name: p for p in parameter_overrides or []}}
        self._on_set_parameters_callbacks: list[Callable[[Any], Any]] = []
        self._publishers: list[Publisher] = []
        self._subscriptions: list[Subscription] = []
        self._timers: list[Any] = []
        self._logger = Logger(self.world)
        self.is_destroyed = False
        self.declare_parameter("use_sim_time", False)
        self.own = {name: getattr(self, name) for name in self.OWN if hasattr(self, name)}
        self.world.nodes.append(self)

    def __setattr__(self, name: str, value: Any) -> None:
        assert not hasattr(self, "own") or name not in self.OWN, f"{name} is an attribute of rclpy's Node"
        super().__setattr__(name, value)

    def get_name(self) -> str:
        return self._name

    def get_logger(self) -> Logger:
        return self._logger

    def get_clock(self) -> Any:
        return SimpleNamespace(now=self.world.now)

    def resolve_topic_name(self, topic: str, *, only_expand: bool = False) -> str:
        def expanded(name: str) -> str:
            return name if name.startswith("/") else f"{self._namespace.rstrip('/')}/{name}"

        remapped = {expanded(old): expanded(new) for old, new in self.world.remappings.items()}
        full = expanded(topic)
        return full if only_expand else remapped.get(full, full)

    def count_publishers(self, topic: str) -> int:
        return self.world.offered.get(self.resolve_topic_name(topic), 0)

    def declare_parameter(self, name: str, value: Any = None, descriptor: Any = None) -> Parameter:
        if name in self._parameters:
            raise ParameterException("Parameter(s) already declared", name)
        made = self.world.definitions["rcl_interfaces/msg/ParameterDescriptor"]
        descriptor = made() if descriptor is None else descriptor
        if not isinstance(descriptor, made):
            raise TypeError(f"Third element {descriptor} is not a ParameterDescriptor.")
        kind = Parameter.Type.from_parameter_value(value)
        if kind == Parameter.Type.NOT_SET:
            raise ValueError("Cannot declare a statically typed parameter with default value of type PARAMETER_NOT_SET")
        descriptor.type = kind.value
        parameter = self._parameter_overrides.get(name, Parameter(name, value=value))
        if problem := self._problem(parameter, descriptor, is_declared=False):
            raise ParameterException(f"Invalid parameter value ({parameter.value}) for parameter. Reason: {problem}", name)
        for callback in self._on_set_parameters_callbacks:
            assert callback([parameter]).successful
        self._parameters[name], self._descriptors[name] = parameter, descriptor
        return parameter

    def _problem(self, parameter: Parameter, descriptor: Any, *, is_declared: bool) -> str:
        if is_declared and descriptor.read_only:
            return f"Trying to set a read-only parameter: {parameter.name}."
        if parameter.type_ != descriptor.type:
            return f"Wrong parameter type, expected '{Parameter.Type(descriptor.type)}' got '{parameter.type_}'"
        for kind, ranges in (
            (Parameter.Type.INTEGER, descriptor.integer_range), (Parameter.Type.DOUBLE, descriptor.floating_point_range)
        ):
            if parameter.type_ == kind and ranges:
                low, high, step = ranges[0].from_value, ranges[0].to_value, ranges[0].step
                if not low <= parameter.value <= high:
                    return f"Parameter {parameter.name} out of range. Min: {low}, Max: {high}, value: {parameter.value}"
                if step and (parameter.value - low) % step:
                    return f"The parameter value for {parameter.name} is not a valid step."
        return ""

    def get_parameter(self, name: str) -> Parameter:
        if name not in self._parameters:
            raise ParameterException("Invalid access to undeclared parameter(s)", name)
        return self._parameters[name]

    def add_on_set_parameters_callback(self, callback: Callable[[Any], Any]) -> None:
        self._on_set_parameters_callbacks.insert(0, callback)

    def set_parameters_atomically(self, parameters: list[Parameter]) -> Any:
        result = self.world.definitions["rcl_interfaces/msg/SetParametersResult"]
        for parameter in parameters:
            self.get_parameter(parameter.name)
            if problem := self._problem(parameter, self._descriptors[parameter.name], is_declared=True):
                return result(successful=False, reason=problem)
        for callback in self._on_set_parameters_callbacks:
            answer = callback(parameters)
            assert isinstance(answer, result)
            if not answer.successful:
                return answer
        self._parameters.update({parameter.name: parameter for parameter in parameters})
        return result(successful=True)

    @staticmethod
    def _profile(qos: Any) -> QoSProfile:
        if isinstance(qos, QoSProfile):
            return qos
        if type(qos) is not int or qos < 0:
            raise TypeError(f"Expected QoSProfile or int, but received {type(qos)!r}")
        return QoSProfile(depth=qos)

    def create_publisher(self, kind: type, topic: str, qos: Any) -> Publisher:
        self._publishers.append(Publisher(self, kind, self.resolve_topic_name(topic), self._profile(qos)))
        return self._publishers[-1]

    def create_subscription(
        self, kind: type, topic: str, callback: Any, qos: Any, *, qos_overriding_options: Any = None
    ) -> Subscription:
        profile, name = self._profile(qos), self.resolve_topic_name(topic)
        options = qos_overriding_options or QoSOverridingOptions(())
        for policy in options.policies:
            # Written into the profile that was given.
            now = getattr(profile, policy)
            default = now if policy == "depth" else now.name.lower()
            value = self.declare_parameter(f"qos_overrides.{name}.subscription.{policy}", default).value
            setattr(profile, policy, value if policy == "depth" else type(now)[value.upper()])
        assert len(inspect.signature(callback).parameters) == 1
        self._subscriptions.append(Subscription(kind, name, callback, profile))
        return self._subscriptions[-1]

    def create_timer(self, period: float, callback: Callable[[], None], callback_group: Any = None, clock: Any = None) -> Any:
        self._timers.append(SimpleNamespace(period_s=float(period), callback=callback, clock=clock))
        return self._timers[-1]

    def destroy_node(self) -> None:
        self.is_destroyed = True


@dataclass
class World:
    """What is around the nodes: what launch files give them, other publishers, clocks, and what was logged."""

    definitions: Definitions
    overrides: dict[str, Any] = field(default_factory=dict)
    remappings: dict[str, str] = field(default_factory=dict)
    namespace: str = ""
    incoming: list[Any] = field(default_factory=list)
    """What `rclpy.spin` does: messages with their topic, or functions to call."""
    ending: type[BaseException] = KeyboardInterrupt
    offered: dict[str, int] = field(default_factory=dict)
    steady_s: float = 1000.0
    ros_ns: int = 0
    nodes: list[Node] = field(default_factory=list)
    lines: list[tuple[str, str]] = field(default_factory=list)
    events: list[str] = field(default_factory=list)
    is_initialized: bool = False

    def said(self, level: str) -> list[str]:
        return [line for found, line in self.lines if found == level]

    def now(self) -> Any:
        def to_msg() -> Any:
            return self.definitions["builtin_interfaces/msg/Time"](sec=self.ros_ns // 10**9, nanosec=self.ros_ns % 10**9)

        return SimpleNamespace(nanoseconds=self.ros_ns, to_msg=to_msg)

    def publisher(self, topic: str) -> Publisher:
        """The one of a topic."""
        (found,) = [one for node in self.nodes for one in node._publishers if one.topic == topic]
        return found

    def subscription(self, topic: str) -> Subscription:
        (found,) = [one for node in self.nodes for one in node._subscriptions if one.topic == topic]
        return found

    def send(self, topic: str, message: Any, qos: QoSProfile | None = None) -> int:
        """Sends as a driver does; to how many subscriptions it went."""
        count = 0
        for node in self.nodes:
            for one in node._subscriptions:
                if one.topic == topic and one.kind is type(message) and agree(qos or sensor_data(), one.qos):
                    one.callback(self.definitions.received(self.definitions.serialized(message), message.kind))
                    count += 1
        return count

    def tick(self, seconds: float = 1.0) -> None:
        """Lets time pass, and timers of the steady clock fire once."""
        self.steady_s += seconds
        for node in self.nodes:
            for timer in node._timers:
                assert timer.clock == ClockType.STEADY_TIME
                timer.callback()

    def spin(self, node: Node) -> None:
        self.events.append("spin")
        for one in self.incoming:
            if callable(one):
                one()
            else:
                self.send(*one)
        raise self.ending

    def modules(self) -> dict[str, ModuleType]:
        """What is imported."""
        def init(args: Any = None) -> None:
            self.is_initialized = True
            self.events.append("init")

        def shutdown() -> None:
            assert self.is_initialized
            self.is_initialized = False
            self.events.append("shutdown")

        contents: dict[str, dict[str, Any]] = {
            "rclpy": {"init": init, "spin": self.spin, "ok": lambda: self.is_initialized, "shutdown": shutdown},
            "rclpy.node": {"Node": type("Node", (Node,), {"world": self})},
            "rclpy.clock": {"Clock": lambda *, clock_type: clock_type, "ClockType": ClockType},
            "rclpy.exceptions": {"ParameterException": ParameterException},
            "rclpy.executors": {"ExternalShutdownException": ExternalShutdownException},
            "rclpy.logging": {"get_logger": lambda name: Logger(self)},
            "rclpy.parameter": {"Parameter": Parameter},
            "rclpy.qos": {
                "QoSProfile": QoSProfile, "HistoryPolicy": HistoryPolicy, "ReliabilityPolicy": ReliabilityPolicy,
                "DurabilityPolicy": DurabilityPolicy, "qos_profile_sensor_data": sensor_data(),
            },
            "rclpy.qos_overriding_options": {"QoSOverridingOptions": QoSOverridingOptions},
        }
        made = self.definitions.modules(PACKAGES)
        for name, content in contents.items():
            made[name] = ModuleType(name)
            vars(made[name]).update(content)
        return made


def install(patch: Any, distribution: str) -> World:
    """Puts the modules where a node imports them from."""
    world = World(Definitions(distribution))
    for name, module in world.modules().items():
        patch.setitem(sys.modules, name, module)
    return world
