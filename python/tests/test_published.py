"""Files of others: trajectories and nets."""

import numpy as np
import pytest

import spindoe


def test_trajectories_are_read_and_summed_up(tmp_path):
    (tmp_path / "index.csv").write_text("traj_file,x_spin,y_spin,z_spin\n0,0,6.283185307179586,0\n")
    times = 0.007 * np.arange(12)
    rows = [f"{t:.3f};{3 * t};0;0.3\n" for t in times]
    (tmp_path / "000.csv").write_text("".join(rows))
    (tmp_path / "001.csv").write_text("".join(rows))
    found = spindoe.read_trajectories(tmp_path)
    assert len(found) == 2 and [t.number for t in found.trajectories] == [0, 1]
    first, second = found.trajectories
    np.testing.assert_allclose(first.time_s, times, atol=1e-12)
    np.testing.assert_allclose(first.position_m[:, 0], 3 * times, atol=1e-12)
    np.testing.assert_allclose(first.spin, [0, 2 * np.pi, 0])
    assert second.spin is None
    summary = found.summary()
    assert summary["points"] == 24 and summary["speed_m_s"] == pytest.approx(3.0)
    (tmp_path / "001.csv").write_text("0;1;two;3\n")
    with pytest.raises(ValueError, match="001.csv"):
        spindoe.read_trajectories(tmp_path)


def test_a_net_is_written_as_onnx(tmp_path):
    runtime = pytest.importorskip("onnxruntime")
    for head in ("dots", "dots-large", "outline"):
        path = tmp_path / f"{head}.onnx"
        spindoe.write_onnx(path, head)
        session = runtime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
        assert session.get_inputs() and session.get_outputs()
    with pytest.raises(ValueError, match="head"):
        spindoe.write_onnx(tmp_path / "no.onnx", "other")
    assert not (tmp_path / "no.onnx").exists()
