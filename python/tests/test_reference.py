"""The reference has every public module, and every public name says what it is."""

from __future__ import annotations

import importlib
import inspect
import pkgutil
import sys

import pytest
import spindoe_ros
from conftest import ROOT

import spindoe

MODULES = [
    f"{package.__name__}.{found.name}"
    for package in (spindoe, spindoe_ros)
    for found in pkgutil.iter_modules(package.__path__)
    if not found.name.startswith("_")
]


def _public(module):
    names = getattr(module, "__all__", None)
    for name, value in vars(module).items():
        is_own = name in names if names else getattr(value, "__module__", None) == module.__name__
        if is_own and not name.startswith("_") and (inspect.isclass(value) or inspect.isfunction(value)):
            yield name, value


def test_the_reference_has_every_public_module():
    page = (ROOT / "docs/reference/python.md").read_text()
    assert "::: spindoe\n" in page and len(MODULES) >= 8
    for name in MODULES:
        assert f"::: {name}\n" in page, name


def test_every_public_name_says_what_it_is(monkeypatch):
    pytest.importorskip("rosbags")
    import ros_stand_in

    # The node's module is imported over the stand-in, and no other test is to find it so.
    ros_stand_in.install(monkeypatch, "jazzy")
    monkeypatch.delitem(sys.modules, "spindoe_ros.node", raising=False)
    modules = [spindoe, *map(importlib.import_module, MODULES)]
    del sys.modules["spindoe_ros.node"]
    silent, count = [], 0
    for module in modules:
        for name, value in _public(module):
            members = vars(value).items() if inspect.isclass(value) else ()
            all_names = [(name, value), *((f"{name}.{key}", member) for key, member in members if key[0] != "_")]
            for full, member in all_names:
                is_spoken = inspect.isclass(member) or callable(member) or isinstance(member, (property, classmethod))
                if is_spoken:
                    count += 1
                    if not inspect.getdoc(member):
                        silent.append(f"{module.__name__}.{full}")
    assert count > 100 and not silent, silent
