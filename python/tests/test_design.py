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

import spindoe

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
    assert len(found.pattern) == 12 and len(found.validation) == 8
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


def test_bad_flags_are_named(tmp_path):
    with pytest.raises(ValueError, match="--dots"):
        spindoe.Design(tmp_path / "d", dots=2)
    with pytest.raises(ValueError, match="min_dots"):
        spindoe.Design(tmp_path / "d", min_dots=2)
    with pytest.raises(ValueError, match="resume"):
        spindoe.Design(tmp_path / "d", resume=True)


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
