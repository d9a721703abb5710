"""Validation, and a small design from start to end."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import textwrap

import numpy as np
import pytest
from conftest import ROOT

import spindoe
from spindoe import _native

SMALL = {"dots": 12, "starts": 2, "scout_steps": 2, "climb_steps": 2, "samples": 100}


def test_rates_do_not_depend_on_pieces(table):
    heard = []
    found = spindoe.validate(
        table, "sparse", samples=5000, seed=3, progress=lambda done, _: heard.append(done)
    )
    assert heard[-1] == 5000 and found.samples == 5000
    rates = found.identity
    assert rates.low <= rates.rate <= rates.high and rates.trials + found.skipped == 5000
    assert rates.rate > 0.97 and str(rates).endswith("]")
    again = spindoe.validate(table, "sparse", samples=5000, seed=3)
    assert again.identity == found.identity and again.mean_error_deg == found.mean_error_deg


def test_bad_arguments(table):
    for arguments in ({"protocol": "easy"}, {"recognizer": "best"}, {"samples": 0}, {"sigma_rad": -1.0}):
        with pytest.raises(ValueError):
            spindoe.validate(table, **arguments)


def test_a_design_from_start_to_end(tmp_path):
    events = []
    design = spindoe.Design(tmp_path / "d", seed=1, **SMALL)
    found = pickle.loads(pickle.dumps(design)).run(events.append)
    # Ours in each protocol, the paper's in its own.
    assert len(found.pattern) == 12 and len(found.validation) == 5
    assert {event.stage for event in events} >= {"scout", "climb", "try", "finish"}
    assert any(event.best is not None for event in events)
    assert (tmp_path / "d/stencil/half_a.stl").exists()
    assert spindoe.HashTable.load(tmp_path / "d/table.npz").pattern == found.pattern
    report = json.loads((tmp_path / "d/report.json").read_text())
    assert report["pattern"]["sha256"] == found.pattern.sha256 and repr(found)
    with pytest.raises(ValueError, match="resume"):
        design.run()
    more = spindoe.Design(tmp_path / "d", seed=1, rounds=2, **SMALL).run(resume=True)
    assert more.report["starts"] == 4


def test_a_callback_ends_a_design(tmp_path):
    def enough(_: spindoe.DesignProgress) -> None:
        raise KeyError("enough")

    with pytest.raises(KeyError, match="enough"):
        spindoe.Design(tmp_path / "d", **SMALL).run(enough)


def test_bad_settings_are_named(tmp_path):
    for settings, words in [
        ({"dots": 2}, "dots: expected 4 to 64"),
        ({"starts": -1}, "starts: .*default: 8"),
        ({"samples": 0}, "samples: expected at least 1"),
        ({"protocol": "easy"}, "protocol: .*sparse"),
        ({"recognizer": "paper"}, "recognizer: expected robust or voting, .*is now voting"),
        ({"pictures": ["gif"]}, "pictures: expected one of png, svg"),
        ({"dot_diameter_mm": 0.0}, "dot_diameter_mm"),
        ({"dots": 40, "dot_diameter_mm": 12.0}, "dot_diameter_mm: 40 holes of 12 mm"),
        ({"min_separation_rad": 1.5}, "min_separation_rad: expected 0 to"),
        ({"bound_goal": (0.0, 1.0)}, "bound_goal: expected two positive"),
        ({"keep_out": [((0.0, 0.0, 2.0), 0.3)]}, "keep_out: expected a unit axis"),
        ({"dots": 21, "pattern": "designs/dots20/pattern.csv"}, "dots: expected none beside"),
        ({"protocol": "image", "ball_px": float("nan")}, "ball_px: expected a finite number"),
    ]:
        if "pattern" in settings:
            settings["pattern"] = ROOT / settings["pattern"]
        with pytest.raises(ValueError, match=words):
            spindoe.Design(tmp_path / "d", **settings)
    with pytest.raises(TypeError, match="min_dots"):
        spindoe.Design(tmp_path / "d", min_dots=2)
    with pytest.raises(ValueError, match="budget_s"):
        spindoe.Design(tmp_path / "d").run(budget_s=0.0)
    assert not (tmp_path / "d").exists()


def test_defaults_are_those_of_the_library():
    pattern, theirs = _native.design_request([])
    assert pattern is None
    assert json.loads(spindoe.Design("d")._settings()) == json.loads(theirs)


def test_zones_of_a_pattern_travel_with_it(pattern, tmp_path):
    zone = spindoe.KeepOut((0.0, 0.0, 1.0), 0.05)
    with_zone = spindoe.Pattern._of(pattern._handle.with_keep_out([zone]))
    design = pickle.loads(pickle.dumps(spindoe.Design(tmp_path / "d", pattern=with_zone, starts=3)))
    assert design.pattern.keep_out == (zone,) and design.starts == 3
    with_zone.save(tmp_path / "zone.csv")
    assert spindoe.HashTable.load(tmp_path / "zone.csv").pattern.keep_out == (zone,)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_ends_long_work(tmp_path):
    script = textwrap.dedent(
        """
        import signal, spindoe, sys
        # A process that runs in the background is born deaf to it.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        try:
            print("ready", flush=True)
            spindoe.Design(sys.argv[1], starts=5000, rounds=50, samples=20000).run()
        except KeyboardInterrupt:
            print("interrupted", flush=True)
        """
    )
    with subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "d")], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
        import time

        time.sleep(1.5)
        process.send_signal(signal.SIGINT)
        try:
            assert process.communicate(timeout=60)[0] == "interrupted\n"
        finally:
            process.kill()
        assert process.returncode == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
def test_a_forked_process_has_its_own_threads(table):
    spindoe.validate(table, samples=200)
    script = textwrap.dedent(
        """
        import os, sys, spindoe
        table = spindoe.HashTable.load(sys.argv[1])
        spindoe.validate(table, samples=200)
        child = os.fork()
        if child == 0:
            spindoe.validate(table, samples=200)
            os._exit(0)
        sys.exit(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        """
    )
    path = os.path.join(os.path.dirname(__file__), "../../designs/dots20/table.npz")
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", script, path], timeout=60, check=False
    )
    assert done.returncode == 0


def test_arrays_are_finite(table):
    found = spindoe.validate(table, "image", samples=64)
    assert np.isfinite(found.mean_error_deg)
