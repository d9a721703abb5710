"""Searches in shards and batches of clips: here, and on a Ray cluster of two workers."""

from __future__ import annotations

import csv
import json
import math
import os
import shutil
import signal
import stat
import threading
import time

import matplotlib.image
import pytest
from conftest import ROOT, run

import spindoe
from spindoe import _cluster, batch, search
from spindoe._design import design_of_flags

SMALL = {"dots": 12, "starts": 2, "scout_steps": 2, "climb_steps": 2, "samples": 60, "rounds": 2}
FILES = ("pattern.csv", "table.npz", "stencil/half_a.stl")


def flags() -> list[str]:
    return [f"--config={name}={value}" for name, value in SMALL.items()]


@pytest.fixture(scope="module")
def whole(command, tmp_path_factory):
    """What the command gives that runs all shards in one process."""
    out = tmp_path_factory.mktemp("whole") / "d"
    run(command, "design", *flags(), "--config=shards=2", "-o", out)
    return {name: (out / name).read_bytes() for name in FILES}


def test_shards_from_python_are_those_of_the_command(whole, tmp_path, capsys):
    words = ["--shards", "2", "-o", str(tmp_path / "d"), *flags()]
    assert search.main(words) == 0
    assert capsys.readouterr().out.strip() == str(tmp_path / "d")
    assert {name: (tmp_path / "d" / name).read_bytes() for name in FILES} == whole
    assert search.main(words) == 2 and "choose another folder" in capsys.readouterr().err
    assert search.main(["--shards", "0", "-o", str(tmp_path / "e")]) == 2


def test_a_search_that_was_interrupted_in_the_last_trial_is_continued(whole, tmp_path):
    def die(progress):
        if progress.stage == "halve":
            raise KeyError("killed")

    design = spindoe.Design(tmp_path / "d", **SMALL)
    folders = [design.run_shard(k, 2) for k in (1, 2)]
    with pytest.raises(KeyError, match="killed"):
        spindoe.merge(folders, design.out, die)
    assert (tmp_path / "d/search.json").exists() and not (tmp_path / "d/report.json").exists()
    with pytest.raises(ValueError, match="choose another folder"):
        spindoe.merge(folders, design.out)
    search.search(design, 2)
    assert {name: (tmp_path / "d" / name).read_bytes() for name in FILES} == whole


def test_shards_of_another_search_are_refused(tmp_path):
    design = spindoe.Design(tmp_path / "d", **SMALL)
    folder = design.run_shard(1, 2)
    with pytest.raises(ValueError, match="shard 2/2 is missing"):
        spindoe.merge([folder], tmp_path / "e")
    with pytest.raises(ValueError, match="shard"):
        design.run_shard(3, 2)


def test_flags_of_the_command_line(tmp_path):
    words = [
        "--dots=12", "--keep-out", "0,0,1,25", "--keep-out=2,0,0,9", "--config=min_separation_deg=20",
        "--config", "bound_goal=0.7,0.9", "--config=objective=mean-nn", "--dot-diameter-mm=3.5",
    ]
    zones = [((0.0, 0.0, 1.0), math.radians(25.0)), ((1.0, 0.0, 0.0), math.radians(9.0))]
    expected = spindoe.Design(
        "d", dots=12, keep_out=tuple(spindoe.KeepOut(*zone) for zone in zones), bound_goal=(0.7, 0.9),
        min_separation_rad=math.radians(20.0), objective="mean-nn", dot_diameter_mm=3.5,
    )
    assert design_of_flags("d", words) == expected
    assert design_of_flags("d", []) == spindoe.Design("d")
    for refused, named in [
        (["12"], "12"), (["--dot=3"], "--dot"), (["--dots=2"], "--dots"), (["--camera=dark"], "--camera"),
        (["--resume"], "--output"), (["--shard=1/2", "-o", "x"], "--shard"), (["--budget=9s"], "--budget"),
    ]:
        with pytest.raises(ValueError, match=named) as caught:
            design_of_flags("d", refused)
        assert "\n" not in str(caught.value)
        assert search.main(["--shards", "2", "-o", str(tmp_path / "e"), *refused]) == 2
    assert not (tmp_path / "e").exists()


@pytest.fixture(scope="module")
def clips(pattern, tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    for k in range(2):
        (folder / f"clip-{k}").mkdir()
        drawn = spindoe.synth(
            pattern, 6, seed=k, fps=350.0, spin_rad_s=(0.0, 60.0 + 60.0 * k, 0.0), ball_px=[80, 80]
        )
        for image, truth in drawn:
            name = folder / f"clip-{k}" / truth.everything["image"]
            matplotlib.image.imsave(name, image)
    (folder / "empty").mkdir()
    return [folder / "clip-0", folder / "clip-1", folder / "empty"]


def _check(rows):
    assert [row.get("identified") for row in rows] == [6, 6, None]
    assert rows[0]["rps"] == pytest.approx(9.55, abs=0.5)
    assert rows[1]["rps"] == pytest.approx(19.1, abs=0.5)
    assert "expected images" in rows[2]["reason"]


def test_clips_are_estimated_once(clips, tmp_path, capsys):
    table = ROOT / "designs/dots20/table.npz"
    before = os.umask(0o027)
    try:
        _check(batch.batch(clips, table, tmp_path / "r"))
    finally:
        os.umask(before)
    for name in ("clip-0.json", "clip-1.json", "summary.csv"):
        assert stat.S_IMODE((tmp_path / "r" / name).stat().st_mode) == 0o640, name
    assert sorted(p.name for p in (tmp_path / "r").iterdir()) == ["clip-0.json", "clip-1.json", "summary.csv"]
    kept = (tmp_path / "r/clip-0.json").stat().st_mtime_ns
    words = [*map(str, clips), "--table", str(table), "-o", str(tmp_path / "r")]
    assert batch.main(words) == 0 and "2 of 3 clips" in capsys.readouterr().out
    assert (tmp_path / "r/clip-0.json").stat().st_mtime_ns == kept
    found = json.loads((tmp_path / "r/clip-0.json").read_text())["spin"]
    with (tmp_path / "r/summary.csv").open(newline="") as file:
        row = next(csv.DictReader(file))
    assert [float(row[f"spin_{a}_rad_s"]) for a in "xyz"] == found["spin_rad_s"]
    assert [float(row[f"axis_{a}"]) for a in "xyz"] == found["axis"]
    assert float(row["cov_xz_rad2_s2"]) == found["covariance_rad2_s2"][0][2]
    assert batch.main([str(clips[2]), *words[3:]]) == 3
    assert batch.main([words[0], words[0], *words[3:]]) == 2


def test_a_result_is_kept_only_for_the_same_inputs(clips, tmp_path, monkeypatch):
    shutil.copytree(clips[0], clip := tmp_path / "clip")
    table = shutil.copy(ROOT / "designs/dots20/table.npz", tmp_path / "table.npz")
    times = tmp_path / "times.csv"
    images = sorted(path.name for path in clip.iterdir())
    times.write_text("frame,time_s\n" + "".join(f"{name},{k / 350}\n" for k, name in enumerate(images)))
    flags = ["--times", str(times)]

    def digest() -> str:
        return batch.inputs_sha256(clip, table, flags)

    def is_kept() -> bool:
        """Whether a result that was given is left as it is."""
        result = tmp_path / "r/clip.json"
        result.write_text(json.dumps({"frames": [], "identified": 77, "inputs_sha256": before}))
        batch.batch([clip], table, tmp_path / "r", flags=flags)
        return result.exists() and json.loads(result.read_text())["identified"] == 77

    (tmp_path / "r").mkdir()
    before = digest()
    assert is_kept()
    changes = {
        "flags": lambda: flags.append("--quiet"),
        "a file that a flag names": lambda: times.write_text(times.read_text().replace("0.0\n", "1e-9\n")),
        "an image": lambda: shutil.copy(clip / images[0], clip / images[1]),
        "the table": lambda: shutil.copy(ROOT / "designs/dots24/table.npz", table),
        "the version": lambda: monkeypatch.setattr(batch, "__version__", "0.0.0"),
    }
    for name, change in changes.items():
        before = digest()
        change()
        assert digest() != before, name
    # The other table is not that of this ball: there is no result then, and none of before.
    assert not is_kept() and not (tmp_path / "r/clip.json").exists()


def test_without_ray_it_says_so(monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match="pip install"):
        list(_cluster.run(print, [()], ray="local"))
    with pytest.raises(ValueError, match="cpus"):
        list(_cluster.run(print, [()], cpus=0))


def test_without_a_cluster_it_says_so(capsys, tmp_path):
    pytest.importorskip("ray")
    with pytest.raises(ValueError, match="^ray: expected a cluster at auto, found none: Could not find") as caught:
        list(_cluster.run(print, [()], ray="auto"))
    assert "\n" not in str(caught.value)
    assert search.main(["--shards", "2", "-o", str(tmp_path / "e"), "--ray", "auto"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1


@pytest.fixture(scope="module")
def cluster():
    """A cluster of two workers on this machine."""
    ray = pytest.importorskip("ray")
    with pytest.MonkeyPatch.context() as patch:
        # Workers import the same package as this process.
        patch.setenv("RAY_USAGE_STATS_ENABLED", "0")
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False, logging_level="error")
        yield ray
        ray.shutdown()


@pytest.mark.filterwarnings("ignore")
def test_more_cores_than_there_are(cluster):
    with pytest.raises(ValueError, match="^cpus: expected at most 2, the cores of this machine, found 3$"):
        list(_cluster.run(abs, [(-1,)], ray="local", cpus=3))


@pytest.mark.filterwarnings("ignore")
def test_what_a_task_raises_is_raised_here(cluster):
    with pytest.raises(json.JSONDecodeError, match="^Expecting value: line 1"):
        list(_cluster.run(json.loads, [("no json",)], ray="auto"))


@pytest.mark.filterwarnings("ignore")
def test_a_killed_worker_is_replaced(cluster, whole, tmp_path):
    out = tmp_path / "d"
    killed = []
    over = threading.Event()

    def kill_once() -> None:
        """Kills the worker of shard 1 once its checkpoint is there."""
        checkpoint = out / "shards/1/search.json"
        while not over.is_set():
            if checkpoint.exists():
                pids = [int(p) for p in os.listdir("/proc") if p.isdigit() and _is_shard(int(p))]
                if pids:
                    os.kill(pids[0], signal.SIGKILL)
                    killed.append(pids[0])
                    return
            time.sleep(0.01)

    killer = threading.Thread(target=kill_once)
    killer.start()
    try:
        found = search.search(spindoe.Design(out, **SMALL), 2, ray="auto")
    finally:
        over.set()
        killer.join()
    assert killed, "no worker was killed while it worked"
    assert {name: (out / name).read_bytes() for name in FILES} == whole
    assert found.report["starts"] == 8


def _is_shard(pid: int) -> bool:
    """Whether the process is a Ray worker that runs a shard."""
    try:
        with open(f"/proc/{pid}/cmdline", "rb") as file:
            return file.read().startswith(b"ray::_shard")
    except OSError:
        return False


@pytest.mark.filterwarnings("ignore")
def test_clips_on_a_cluster(cluster, clips, tmp_path):
    _check(batch.batch(clips, ROOT / "designs/dots20/table.npz", tmp_path / "r", ray="auto"))
