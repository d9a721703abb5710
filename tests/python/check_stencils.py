#!/usr/bin/env python3
"""Examines stencils with tools that are independent of the crate: trimesh, lib3mf, Manifold, admesh, PrusaSlicer.

    check_stencils.py DIR [--slicer N] [--jobs N] [--json FILE]

DIR holds folders with half_a.stl, half_b.stl, stencil.3mf, stencil.json and pattern.csv, as the program
`bench stencils` leaves them. Needs trimesh, manifold3d, embreex, lib3mf, lxml, networkx, numpy, scipy; admesh
and prusa-slicer where they are installed.

For every stencil:
  solid      each half is watertight, wound consistently, one body, with the Euler characteristic that its
             through-holes demand (2 - 2 * holes)
  volume     each half against a quadrature of the ideal solid (spheres, cones, cylinders; 2^17 Sobol points):
             within 0.5 %. Engraved numbers are no part of the ideal solid: stencils with numbers may lack
             up to 2 % more.
  overlap    volume common to both halves, closed and opened by 2 to 100 degrees, and of either with the ball
  rays       from the ball's center along each dot of pattern.csv nothing is hit; 0.2 mm beside each hole, in
             eight directions, wall is hit
  centers    circles fitted to the vertices of each throat, against pattern.csv
  admesh     no open edge, no flipped facet
  3mf        trimesh and lib3mf find two valid objects in millimeters, side by side, with the STL files' triangles
  pin        a printed pin is a solid as above, overlaps neither half at any opening, and head and barb hold it
  slicer     PrusaSlicer's --info of STL and 3MF (the first N stencils only)
"""

import argparse
import collections
import csv
import json
import multiprocessing
import re
import shutil
import subprocess
import sys
from pathlib import Path

import lib3mf
import numpy as np
import trimesh
from scipy.spatial import ConvexHull
from scipy.stats import qmc

OPENINGS_DEG = [0, 2, 5, 10, 15, 20, 30, 45, 60, 80, 100]
MOST_OVERLAP_MM3 = 0.5
MOST_CENTER_MM = 0.02
BESIDE_MM = 0.2
VOLUME_TOLERANCE = 0.005
ENGRAVING_ALLOWANCE = 0.02


def rotation(q):
    """Matrix of a unit quaternion given as a mapping with qw, qx, qy, qz."""
    w, x, y, z = q["qw"], q["qx"], q["qy"], q["qz"]
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def read_pattern(path):
    """Unit vectors of a pattern, with or without a header."""
    with open(path) as file:
        rows = [row for row in csv.reader(file) if row]
    if rows[0][0].strip() == "x":
        rows = rows[1:]
    return np.array(rows, dtype=float)


class Sizes:
    """The lengths of one stencil, mm."""

    def __init__(self, info):
        self.p, self.j = info["parameters"], info["joint"]
        self.ball = 0.5 * self.p["ball_diameter_mm"]
        self.inner = self.ball + self.p["clearance_mm"]
        self.outer = self.inner + self.p["wall_mm"]
        self.throat = 0.5 * self.p["hole_diameter_mm"]
        # The dome's inside is relieved within 25 degrees of its top.
        self.relief = min(self.p.get("ceiling_relief_mm", 0), 0.5 * self.p["throat_mm"], 0.25 * self.p["wall_mm"])
        self.ceiling = self.inner * np.sin(np.radians(25))

    def hole(self, height):
        rise = np.maximum(height - self.inner - self.p["throat_mm"], 0)
        return self.throat + rise * np.tan(np.radians(self.p["taper_deg"]))


def inside_hull(points, outline):
    """Whether points of the plane lie in the convex hull of `outline`."""
    inside = np.all((points >= outline.min(axis=0)) & (points <= outline.max(axis=0)), axis=1)
    equations = ConvexHull(outline).equations
    inside[inside] = np.all(points[inside] @ equations[:, :2].T + equations[:, 2] <= 0, axis=1)
    return inside


def ideal(points, dots, is_a, s, windows=()):
    """Whether points lie in the ideal half, in its own frame (dome up, center of the ball in 0)."""
    j, p = s.j, s.p
    x, y, z = points.T
    radius, flat = np.linalg.norm(points, axis=1), np.hypot(x, y)
    lip, ledge = j["lip_mm"], j["lip_mm"] + j["ledge_gap_mm"]
    slope = (j["cone_narrow_mm"] - j["cone_wide_mm"]) / (2 * lip)
    half_hinge = 0.5 * p["hinge_length_mm"]
    turn = np.linspace(0, 2 * np.pi, 181)
    circle = np.stack([np.cos(turn), np.sin(turn)], 1)

    root = np.sqrt(max(s.inner**2 - half_hinge**2 - j["arm_mm"] ** 2, s.inner**2 / 4))
    knuckle = circle * j["knuckle_radius_mm"] + [j["axis_mm"], 0]
    outline = np.vstack([knuckle, [[root, j["arm_mm"]], [root, -lip]]])
    xz = points[:, [0, 2]]
    arm = inside_hull(xz, outline)
    if not is_a:
        arm &= (z >= 0) & inside_hull(xz, np.vstack([outline, [[root, 0]]]))
        arm |= np.hypot(x - j["axis_mm"], z) < j["knuckle_radius_mm"]
    pitch = j["knuckle_mm"] + p["knuckle_clearance_mm"]
    along = y + half_hinge
    index = np.floor(along / pitch)
    arm &= (along >= 0) & (index < p["knuckles"]) & (along - index * pitch < j["knuckle_mm"])
    arm &= (index % 2 == 0) == is_a
    solid = (radius < s.outer) | arm
    if is_a:
        half = 0.5 * j["tab_width_mm"]
        r = min(3.0, 0.5 * half, 0.5 * p["tab_mm"])
        start = np.sqrt(max(s.inner**2 - half**2, 1.0))
        reach = s.outer + p["tab_mm"] - r
        tab = np.vstack([circle * r + [-reach, half - r], circle * r + [-reach, r - half],
                         [[-start, half], [-start, -half]]])
        solid |= inside_hull(points[:, :2], tab) & (z < j["tab_thickness_mm"] - lip)
    solid &= (radius > s.inner) & (z > -lip)
    solid &= ~((radius < s.inner + s.relief) & (flat < s.ceiling) & (z > 0))

    if is_a:
        face = j["cone_wide_mm"] + (np.minimum(z, lip) + lip) * slope + j["half_gap_mm"]
        solid &= ~((flat < face) & (z < ledge))
    else:
        # In half B's own frame the cone widens upwards.
        face = j["cone_wide_mm"] + (lip - np.minimum(z, lip)) * slope - j["half_gap_mm"]
        slot = s.outer + 0.75 * p["knuckle_clearance_mm"]
        solid &= ~((flat > face) & (flat < slot) & (z < ledge))
        out = 0.5 * (j["cone_wide_mm"] + s.outer)
        edge = j["cone_wide_mm"] + j["half_gap_mm"]
        passing = np.hypot(j["axis_mm"] - np.sqrt(np.maximum(edge**2 - y**2, 0)), lip)
        near = np.hypot(x - j["axis_mm"], z) < passing + 0.5 * p["seam_gap_mm"]
        solid &= ~(near & (flat < out) & (x > 0) & (z < lip + 0.5 * j["ledge_gap_mm"]))
    solid &= np.hypot(x - j["axis_mm"], z) > j["bore_radius_mm"]
    for d in dots:
        height = points @ d
        beside = np.sqrt(np.maximum(radius**2 - height**2, 0))
        solid &= ~((height > 0.6 * s.inner) & (beside < s.hole(height)))
    for axis, r in windows:
        height = points @ axis
        solid &= ~((height > 0) & (np.maximum(radius**2 - height**2, 0) < r * r))
    return solid


def ideal_volume(dots, is_a, s, windows=()):
    """Volume of the ideal half by quadrature, mm^3."""
    u = qmc.Sobol(3, scramble=True, seed=1).random_base2(17)
    lip = s.j["lip_mm"]
    # The shell above the bed: the radius uniform in r^3, z uniform on the sphere.
    low = -lip / s.inner
    r = np.cbrt(s.inner**3 + u[:, 0] * (s.outer**3 - s.inner**3))
    z = low + (1 - low) * u[:, 1]
    angle = 2 * np.pi * u[:, 2]
    f = np.sqrt(np.maximum(1 - z * z, 0))
    shell = r[:, None] * np.stack([f * np.cos(angle), f * np.sin(angle), z], 1)
    volume = 2 * np.pi * (1 - low) / 3 * (s.outer**3 - s.inner**3)
    total = volume * np.mean(ideal(shell, dots, is_a, s, windows))
    # What stands out of the shell.
    half = 0.5 * s.p["hinge_length_mm"]
    width = 0.5 * s.j["tab_width_mm"]
    beyond = s.j["axis_mm"] + s.j["knuckle_radius_mm"]
    top = max(s.j["arm_mm"], s.j["knuckle_radius_mm"])
    u = u[: len(u) // 8]
    boxes = [((0.6 * s.outer, -half, -lip), (beyond, half, top))]
    if is_a:
        boxes.append(((-s.outer - s.p["tab_mm"], -width, -lip), (-0.6 * s.outer, width, 3.0)))
    for a, b in boxes:
        a, b = np.array(a), np.array(b)
        points = a + u * (b - a)
        counted = ideal(points, dots, is_a, s, windows) & (np.linalg.norm(points, axis=1) >= s.outer)
        total += np.prod(b - a) * np.mean(counted)
    return total


def placed(mesh, is_a, degrees, s):
    """A half where it stands in the stencil frame when the stencil is open by `degrees`."""
    mesh = mesh.copy()
    mesh.apply_translation([0, 0, -s.j["lip_mm"]])
    if not is_a:
        turn = trimesh.transformations.rotation_matrix
        mesh.apply_transform(turn(np.pi, [1, 0, 0]))
        mesh.apply_transform(turn(-np.radians(degrees), [0, 1, 0], [s.j["axis_mm"], 0, 0]))
    return mesh


def overlap(a, b):
    """Volume common to two meshes, mm^3."""
    common = trimesh.boolean.intersection([a, b], engine="manifold")
    return 0.0 if common.is_empty else abs(common.volume)


def center_offset(vertices, d, s):
    """Distance on the ball between the dot `d` and the axis of the throat drilled for it, mm."""
    height = vertices @ d
    beside = vertices - height[:, None] * d
    distance = np.linalg.norm(beside, axis=1)
    radius = np.linalg.norm(vertices, axis=1)
    end = s.inner + s.p["throat_mm"]
    on = (np.abs(distance - s.throat) < 0.03) & (radius > s.inner - 0.05) & (height < end + 0.01)
    e = np.cross(d, [1, 0, 0] if abs(d[0]) < 0.7 else [0, 1, 0])
    e /= np.linalg.norm(e)
    q = np.stack([beside[on] @ e, beside[on] @ np.cross(d, e)], 1)
    # Circle through the points in the least-squares sense (Kasa): |q|^2 = 2 c.q + k.
    system = np.column_stack([2 * q, np.ones(len(q))])
    c = np.linalg.lstsq(system, np.sum(q * q, axis=1), rcond=None)[0][:2]
    return float(np.linalg.norm(c) * s.ball / s.inner), int(on.sum())


def probe(whole, dots, s):
    """Rays that should leave and do not, and rays that should hit wall and do not."""
    angle = np.arcsin((s.throat + BESIDE_MM) / s.inner)
    beside = []
    for d in dots:
        e = np.cross(d, [1, 0, 0] if abs(d[0]) < 0.7 else [0, 1, 0])
        e /= np.linalg.norm(e)
        f = np.cross(d, e)
        for t in np.linspace(0, 2 * np.pi, 8, endpoint=False):
            beside.append(np.cos(angle) * d + np.sin(angle) * (np.cos(t) * e + np.sin(t) * f))
    directions = np.vstack([dots, beside])
    hit = whole.ray.intersects_any(np.zeros_like(directions), directions)
    n = len(dots)
    return int(hit[:n].sum()), int((~hit[n:]).sum())


def window_rays(whole, window, dots, s):
    """Rays along a window's axis that meet the wall within it, and that meet none 0.3 mm beside it."""
    axis = np.array(window["axis"])
    u = np.cross(axis, [1, 0, 0] if abs(axis[0]) < 0.7 else [0, 1, 0])
    u /= np.linalg.norm(u)
    v = np.cross(axis, u)
    turn = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    ring = np.cos(turn)[:, None] * u + np.sin(turn)[:, None] * v
    def count(r):
        # From within the ball, along the axis.
        start = r * ring + 0.2 * s.inner * axis
        return whole.ray.intersects_any(start, np.tile(axis, (len(start), 1)))
    inside = sum(int(count(f * window["radius_mm"]).sum()) for f in (0.0, 0.5, 0.98))
    r = window["radius_mm"] + 0.3
    beside = int((~count(r)).sum()) if r < s.inner else 0
    return inside, beside


def pin_faults(path, halves, s):
    """The faults of the hinge's printed pin: its solid, its way through the knuckles, and its hold in them."""
    pin = trimesh.load_mesh(path)
    faults = [f"pin: {what}" for what, good in [
        ("watertight", pin.is_watertight), ("winding", pin.is_winding_consistent),
        ("one body", pin.body_count == 1), ("Euler", pin.euler_number == 2),
        ("on the bed", abs(pin.bounds[0][2]) < 1e-5)] if not good]
    # The middle of its axis: the head is as wide as a knuckle, and stands out only upwards.
    radius = s.j["knuckle_radius_mm"]
    head, play, length = 1.6, 0.6, s.p["hinge_length_mm"]
    pin.apply_translation([-head - 0.5 * play - 0.5 * length, 0, radius - pin.bounds[1][2]])
    pin.apply_transform(trimesh.transformations.rotation_matrix(0.5 * np.pi, [0, 0, 1]))
    pin.apply_translation([s.j["axis_mm"], 0, 0])
    a = placed(halves[0], True, 0, s)
    for degrees in (0, 20, 60, 100):
        common = overlap(pin, a) + overlap(pin, placed(halves[1], False, degrees, s))
        if common > MOST_OVERLAP_MM3:
            faults.append(f"pin: overlaps the halves by {common:.2f} mm^3, opened by {degrees} degrees")
    for way in (-1, 1):
        moved = pin.copy()
        moved.apply_translation([0, way * (play + 0.4), 0])
        if overlap(moved, a) < 0.02:
            faults.append("pin: nothing keeps it in the knuckles")
    return faults


def admesh_faults(path):
    """Open edges and flipped facets as admesh counts them; None where it is not installed."""
    if shutil.which("admesh") is None:
        return None
    text = subprocess.run(["admesh", str(path)], capture_output=True, text=True).stdout
    faults = 0
    for name in ["Facets with 1 disconnected edge", "Facets with 2 disconnected edges",
                 "Facets with 3 disconnected edges", "Degenerate facets", "Edges fixed", "Facets removed",
                 "Facets added", "Facets reversed", "Backwards edges"]:
        found = re.search(rf"{name}\s*:\s*(\d+)", text)
        faults += int(found.group(1)) if found else 1
    return faults


def slicer_manifold(path):
    """Whether PrusaSlicer finds the file manifold without repairing it."""
    text = subprocess.run(["prusa-slicer", "--info", str(path)], capture_output=True, text=True).stdout
    return "manifold = yes" in text and "open_edges" not in text and "facets_reversed" not in text \
        and "edges_fixed" not in text and "degenerate_facets" not in text


def threemf_faults(path, halves):
    """The faults of a 3MF file that should hold `halves`, as trimesh and lib3mf read it."""
    faults = []
    scene = trimesh.load_scene(path)
    parts = sorted(scene.dump(), key=lambda part: part.bounds[0][0])
    if len(parts) != 2 or scene.units not in ("mm", "millimeter", "millimeters"):
        return [f"3MF: trimesh finds {len(parts)} objects in {scene.units}"]
    for part, half in zip(parts, halves):
        if len(part.faces) != len(half.faces) or not part.is_watertight:
            faults.append("3MF: trimesh finds other triangles than in the STL file")
        if abs(part.volume / half.volume - 1) > 1e-6 or np.abs(part.extents - half.extents).max() > 1e-4:
            faults.append("3MF: trimesh finds another solid than in the STL file")
    if parts[0].bounds[1][0] >= parts[1].bounds[0][0]:
        faults.append("3MF: the halves overlap on the bed")
    wrapper = lib3mf.get_wrapper()
    model = wrapper.CreateModel()
    reader = model.QueryReader("3mf")
    reader.SetStrictModeActive(True)
    reader.ReadFromFile(str(path))
    if reader.GetWarningCount():
        faults.append(f"3MF: lib3mf warns: {reader.GetWarning(0)}")
    objects, found = model.GetMeshObjects(), []
    while objects.MoveNext():
        mesh = objects.GetCurrentMeshObject()
        if not (mesh.IsValid() and mesh.IsManifoldAndOriented()):
            faults.append(f"3MF: lib3mf finds {mesh.GetName()} invalid")
        found.append(mesh.GetTriangleCount())
    if found != [len(half.faces) for half in halves]:
        faults.append(f"3MF: lib3mf finds objects of {found} triangles")
    return faults


def check(job):
    """Examines one folder; returns its values and a list of faults."""
    folder, with_slicer = job
    info = json.loads((folder / "stencil.json").read_text())
    s = Sizes(info)
    pattern = read_pattern(folder / "pattern.csv")
    pattern /= np.linalg.norm(pattern, axis=1)[:, None]
    dots = pattern @ rotation(info["rotation_pattern_to_stencil"]).T
    flipped = dots * [1, -1, -1]
    faults, row = [], {"folder": folder.name, "dots": len(dots), "numbers": s.p["numbers"]}
    halves = []
    for name, is_a in [("half_a", True), ("half_b", False)]:
        path = folder / f"{name}.stl"
        mesh = trimesh.load_mesh(path)
        halves.append(mesh)
        holes = info[name]["through_holes"]
        for what, good in [("watertight", mesh.is_watertight), ("winding", mesh.is_winding_consistent),
                           ("one body", mesh.body_count == 1), ("positive volume", mesh.volume > 0),
                           ("Euler", mesh.euler_number == 2 - 2 * holes),
                           ("on the bed", abs(mesh.bounds[0][2]) < 1e-5)]:
            if not good:
                faults.append(f"{name}: {what}")
        own = np.array([1, 1, 1] if is_a else [1, -1, -1])
        windows = [(np.array(w["axis"]) * own, w["radius_mm"]) for w in info.get("windows", [])
                   if w["half"] == ("a" if is_a else "b")]
        off = mesh.volume / ideal_volume(dots if is_a else flipped, is_a, s, windows) - 1
        row[f"{name}_volume_off"] = off
        if off > VOLUME_TOLERANCE or off < -VOLUME_TOLERANCE - ENGRAVING_ALLOWANCE * s.p["numbers"]:
            faults.append(f"{name}: volume {100 * off:+.2f} %")
        row[f"{name}_triangles"] = len(mesh.faces)
        row[f"{name}_bytes"] = path.stat().st_size
        angles = np.degrees(mesh.face_angles.min(axis=1))
        row[f"{name}_least_angle_deg"] = float(angles.min())
        row[f"{name}_share_under_1_deg"] = float(np.mean(angles < 1))
        bad = admesh_faults(path)
        if bad:
            faults.append(f"{name}: admesh finds {bad} faults")
        if with_slicer and not slicer_manifold(path):
            faults.append(f"{name}: PrusaSlicer repairs it")
    faults += threemf_faults(folder / "stencil.3mf", halves)
    if with_slicer and not slicer_manifold(folder / "stencil.3mf"):
        faults.append("3MF: PrusaSlicer repairs it")
    a = placed(halves[0], True, 0, s)
    row["overlap_mm3"] = 0.0
    for degrees in OPENINGS_DEG:
        common = overlap(a, placed(halves[1], False, degrees, s))
        row["overlap_mm3"] = max(row["overlap_mm3"], common)
        if common > MOST_OVERLAP_MM3:
            faults.append(f"opened by {degrees} degrees the halves overlap by {common:.2f} mm^3")
    b = placed(halves[1], False, 0, s)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=s.ball)
    row["ball_mm3"] = max(overlap(ball, a), overlap(ball, b))
    if row["ball_mm3"] > MOST_OVERLAP_MM3:
        faults.append(f"the ball overlaps by {row['ball_mm3']:.2f} mm^3")
    whole = trimesh.util.concatenate([a, b])
    for w in info.get("windows", []):
        # Each window is open over its whole width, and closed just beside it unless a hole is there.
        inside, beside = window_rays(whole, w, dots, s)
        if inside or beside:
            faults.append(f"window {w['zone']}: {inside} rays meet the wall, {beside} beside it meet none")
    row["windows"] = len(info.get("windows", []))
    blocked, missed = probe(whole, dots, s)
    row["blocked_rays"], row["missed_rays"] = blocked, missed
    if blocked or missed:
        faults.append(f"{blocked} holes are blocked, {missed} rays beside a hole meet no wall")
    offsets = [center_offset(whole.vertices, d, s) for d in dots]
    row["pin"] = s.p.get("closure") == "pin"
    if row["pin"]:
        faults += pin_faults(folder / "pin.stl", halves, s)
    row["center_mm"] = max(o for o, _ in offsets)
    if row["center_mm"] > MOST_CENTER_MM:
        faults.append(f"a hole's center is off by {row['center_mm']:.3f} mm")
    if min(n for _, n in offsets) < 8:
        faults.append("a throat has too few vertices to be measured")
    return row, faults


def main():
    parser = argparse.ArgumentParser(description="Examines stencils with independent tools.")
    parser.add_argument("dir", type=Path)
    parser.add_argument("--slicer", type=int, default=0, help="stencils that PrusaSlicer examines too")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--json", type=Path, help="keep every stencil's values here; stencils that it already holds are skipped")
    options = parser.parse_args()
    folders = sorted((p.parent for p in options.dir.glob("*/stencil.json")), key=lambda p: int(p.name))
    rows = []
    if options.json and options.json.exists():
        rows = json.loads(options.json.read_text())
    known = {row["folder"] for row in rows}
    jobs = [(f, i < options.slicer) for i, f in enumerate(folders) if f.name not in known]
    with multiprocessing.Pool(options.jobs) as pool:
        for row, faults in pool.imap(check, jobs, chunksize=2):
            rows.append(row | {"faults": faults})
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")
    if (options.dir / "survey.csv").exists():
        count_outcomes(options.dir / "survey.csv")
    return summarize(rows)


def count_outcomes(path):
    """Prints how many patterns were built, and how many rejected for which reason."""
    with path.open() as file:
        lines = list(csv.DictReader(file))
    outcomes = collections.Counter(line["outcome"] for line in lines)
    print(f"{len(lines)} patterns: " + ", ".join(f"{n} {name}" for name, n in outcomes.most_common()))
    seconds = [float(line["seconds"]) for line in lines if line["outcome"] == "built"]
    print(f"seconds a stencil: median {np.median(seconds):.2f}, maximum {max(seconds):.2f}")


def summarize(rows):
    """Prints the results; returns 1 where there are faults, else 0."""
    faulty = [row for row in rows if row["faults"]]
    for row in faulty:
        print(f"{row['folder']}: {'; '.join(row['faults'])}")
    both = lambda key: np.array([row[f"{half}_{key}"] for row in rows for half in ("half_a", "half_b")])
    print(f"{len(rows)} stencils examined, {len(faulty)} with faults")
    for name, numbers in [("without", False), ("with", True)]:
        off = [100 * row[f"{half}_volume_off"] for row in rows if row["numbers"] == numbers
               for half in ("half_a", "half_b")]
        if off:
            print(f"volume against quadrature, {name} numbers: {min(off):+.3f} to {max(off):+.3f} %")
    print(f"maximum overlap of the halves, closed or opened: {max(r['overlap_mm3'] for r in rows):.4f} mm^3")
    print(f"maximum overlap with the ball: {max(r['ball_mm3'] for r in rows):.4f} mm^3")
    print(f"holes blocked: {sum(r['blocked_rays'] for r in rows)} of {sum(r['dots'] for r in rows)}; "
          f"rays beside holes that meet no wall: {sum(r['missed_rays'] for r in rows)}")
    print(f"maximum offset of a hole's center: {max(r['center_mm'] for r in rows):.4f} mm")
    print(f"triangles a half: median {np.median(both('triangles')):.0f}, maximum {both('triangles').max()}; "
          f"largest STL {both('bytes').max() / 1024:.0f} KiB")
    print(f"share of triangles under 1 degree: mean {100 * both('share_under_1_deg').mean():.3f} %, "
          f"maximum {100 * both('share_under_1_deg').max():.2f} %; "
          f"minimum angle: median {np.median(both('least_angle_deg')):.2f} degrees")
    return 1 if faulty else 0


if __name__ == "__main__":
    sys.exit(main())
