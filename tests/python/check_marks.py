#!/usr/bin/env python3
"""Reads the files of `spindoe mark` with independent readers, and maps their dots back onto the ball.

    check_marks.py PATTERN.csv FILE...

Readers: svgpathtools for SVG, pdfplumber for PDF, ezdxf for DXF, and a small interpreter of G-code below. Each
file says in a JSON note how its coordinates lie on the ball; the pattern is read on its own. For every file:

  place      the circle through the rim of each dot, laid back on the ball, has its center within 0.1 mm of the
             pattern's dot
  rim        every point of an outline lies within 0.1 mm of the dot's rim
  area       each dot covers 99.5 to 100.5 % of itself
  cuts       every dot of a lobe lies within its cut, and no cut comes within a dot
  numbers    every dot's number stands once, off every dot and cut
  stickers   the single dots have the dot's diameter; the table's angles and distances are the pattern's, and its
             heading stands on every page that has a row of it
  block      every sheet says the pattern, the ball and the dots
  plotter    the pen reaches the rim, inks every point of the dot, never draws while it travels, and keeps its speed
  pages      PDF pages are A4 or Letter, and the check line is 200 mm long

Needs numpy, svgpathtools, pdfplumber, ezdxf.
"""

import csv
import json
import re
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import ezdxf
import numpy as np
import pdfplumber
from svgpathtools import parse_path

MOST_MM = 0.1
POINT_MM = 25.4 / 72
# Height of the title block at a sheet's foot, with its margin.
BLOCK_MM = 20
SVG = "{http://www.w3.org/2000/svg}"


class Faults(list):
    """Collects faults."""

    def expect(self, good, words):
        if not good:
            self.append(words)


def read_pattern(path):
    with open(path) as file:
        rows = [row for row in csv.reader(file) if row]
    if rows[0][0].strip() == "x":
        rows = rows[1:]
    dots = np.array(rows, dtype=float)
    return dots / np.linalg.norm(dots, axis=1)[:, None]


def rotation(q):
    """Matrix of a unit quaternion given as a mapping with qw, qx, qy, qz."""
    w, x, y, z = q["qw"], q["qx"], q["qy"], q["qz"]
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


class Sheet:
    """What a reader found on one page: filled or closed outlines, open lines and words, mm, y upwards."""

    def __init__(self, width, height):
        self.size = (width, height)
        self.areas, self.loops, self.lines, self.words, self.boxes = [], [], [], [], []


def read_svg(path, faults):
    root = ET.parse(path).getroot()
    note = json.loads(root.find(SVG + "metadata").text)
    width, height = root.get("viewBox").split()[2:]
    # A plotter's units are its steps, without a size.
    unit = "" if note["kind"] == "plotter" else "mm"
    true = (root.get("width"), root.get("height")) == (f"{width}{unit}", f"{height}{unit}")
    faults.expect(true, "the SVG is not true to size")
    height = float(height)
    sheet = Sheet(float(width), height)
    for group in root.iter(SVG + "g"):
        for node in group.iter(SVG + "path"):
            path_ = parse_path(node.get("d"))
            ends = [path_[0].start] + [segment.end for segment in path_]
            points = np.array([[p.real, height - p.imag] for p in ends])
            if group.get("id") == "dots":
                (sheet.areas if node.get("fill") else sheet.lines).append(points)
            elif group.get("id") == "cut":
                sheet.loops.append(points)
        for node in group.iter(SVG + "text"):
            sheet.words.append((node.text.strip(), float(node.get("x")), height - float(node.get("y"))))
    return note, [sheet]


def read_pdf(path, faults):
    sheets = []
    with pdfplumber.open(path) as pdf:
        note = json.loads(pdf.metadata["Keywords"])
        for page in pdf.pages:
            height = float(page.height)
            sheet = Sheet(float(page.width) * POINT_MM, height * POINT_MM)
            for shape in page.curves + page.rects:
                points = np.array([[x, height - top] for x, top in shape["pts"]]) * POINT_MM
                red, green, _ = shape["stroking_color"]
                if shape["fill"]:
                    sheet.areas.append(points)
                elif red > 0.8 and green < 0.3:
                    sheet.loops.append(points)
            for line in page.lines:
                points = np.array([[x, height - top] for x, top in line["pts"]]) * POINT_MM
                sheet.lines.append(points)
            for word in page.extract_words(x_tolerance=1):
                at = (word["x0"] * POINT_MM, (height - word["bottom"]) * POINT_MM)
                if at[1] > BLOCK_MM:
                    sheet.words.append((word["text"], *at))
                    size = [(word["x1"] - word["x0"]) * POINT_MM, (word["bottom"] - word["top"]) * POINT_MM]
                    # Letters fill the middle of their box's height.
                    sheet.boxes.append((word["text"], at[0], at[1] + 0.2 * size[1], at[0] + size[0],
                                        at[1] + 0.8 * size[1]))
            sheet.text = page.extract_text()
            sheets.append(sheet)
    return note, sheets


def read_dxf(path, faults):
    lines = path.read_text().splitlines()
    pieces = [b[5:].split(" ", 1)[1] for a, b in zip(lines, lines[1:]) if a == "999" and b.startswith("note ")]
    note = json.loads("".join(pieces))
    sheet = Sheet(0, 0)
    space = ezdxf.readfile(path).modelspace()
    for line in space.query("POLYLINE"):
        points = np.array([[p.x, p.y] for p in line.points()])
        if line.dxf.layer == "DOTS":
            sheet.areas.append(points)
        elif line.dxf.layer == "CUT":
            sheet.loops.append(points)
    for text in space.query("TEXT"):
        sheet.words.append((text.dxf.text, text.dxf.insert.x, text.dxf.insert.y))
    return note, [sheet]


def fitted_center(points):
    """Direction of the center of a circle through unit vectors: the normal of their plane."""
    mean = points.mean(axis=0)
    normal = np.linalg.svd(points - mean)[2][2]
    return normal if normal @ mean > 0 else -normal


def check_rims(found, pattern, note, faults):
    """`found`: a list of dots' outlines, unit vectors in the pattern's frame."""
    radius = 0.5 * note["ball_diameter_mm"]
    edge = np.arcsin(note["dot_diameter_mm"] / note["ball_diameter_mm"])
    rims = [[] for _ in pattern]
    for vectors in found:
        middle = vectors.mean(axis=0)
        dot = int(np.argmax(pattern @ middle))
        angle = np.arccos(np.clip(vectors @ pattern[dot], -1, 1))
        off = radius * (angle - edge)
        faults.expect(off.max() < MOST_MM, f"dot {dot}: a point lies {off.max():.3f} mm outside")
        faults.expect(off.min() > -MOST_MM, f"dot {dot}: a point lies {-off.min():.3f} mm inside its rim")
        rims[dot].append(vectors[np.abs(off) < MOST_MM])
    worst = 0.0
    for dot, parts in enumerate(rims):
        rim = np.vstack(parts) if parts else np.empty((0, 3))
        if len(rim) < 8:
            faults.append(f"dot {dot} is missing")
            continue
        off = radius * np.arccos(np.clip(fitted_center(rim) @ pattern[dot], -1, 1))
        worst = max(worst, off)
        faults.expect(off < MOST_MM, f"dot {dot} is off by {off:.3f} mm")
    return worst


def check_numbers(words, count, n, faults):
    numbers = [int(w) for w, _, _ in words if re.fullmatch(r"\d+", w)]
    for dot in range(n):
        found = numbers.count(dot)
        faults.expect(found >= count, f"the number {dot} stands {found} times")


def contains(loop, points):
    """Which points lie within a closed line."""
    a, b = loop, np.roll(loop, -1, axis=0)
    x, y = points[:, :1], points[:, 1:]
    with np.errstate(divide="ignore", invalid="ignore"):
        meets = a[:, 0] + (y - a[:, 1]) / (b[:, 1] - a[:, 1]) * (b[:, 0] - a[:, 0])
    crossed = ((a[:, 1] > y) != (b[:, 1] > y)) & (x < meets)
    return crossed.sum(axis=1) % 2 == 1


def check_free(sheets, faults):
    """Numbers of a PDF stand off dots and cuts."""
    for sheet in sheets:
        for number, left, low, right, high in sheet.boxes:
            if not re.fullmatch(r"\d+", number):
                continue
            for points in sheet.areas + sheet.loops:
                inside = ((points > [left, low]) & (points < [right, high])).all(axis=1)
                faults.expect(not inside.any(), f"the number {number} meets a dot or a cut")
                middle = np.array([[0.5 * (left + right), 0.5 * (low + high)]])
                faults.expect(not contains(points, middle).any(), f"the number {number} stands in a dot or a lobe")


def check_gores(note, sheets, pattern, faults):
    radius, turn = 0.5 * note["ball_diameter_mm"], rotation(note["rotation_pattern_to_mark"])
    edge = np.arcsin(note["dot_diameter_mm"] / note["ball_diameter_mm"])
    found, areas = [], np.zeros(len(pattern))
    seen = 0
    for index, sheet in enumerate(sheets):
        pieces = [p for p in note["pieces"] if p["page"] == index]
        faults.expect(len(sheet.loops) == len(pieces), f"{len(sheet.loops)} cuts for {len(pieces)} pieces")
        for piece, loop in zip(pieces, sheet.loops):
            s, c = np.sin(np.radians(piece["longitude_deg"])), np.cos(np.radians(piece["longitude_deg"]))

            def on_ball(points):
                u, v = (points - [piece["x_mm"], piece["y_mm"]]).T / radius
                local = np.stack([np.cos(u) * np.cos(v), np.sin(u), np.cos(u) * np.sin(v)], 1)
                return u, v, local @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) @ turn

            cut = on_ball(np.vstack([loop, 0.5 * (loop + np.roll(loop, -1, axis=0))]))[2]
            to_rim = radius * (np.arccos(np.clip(cut @ pattern.T, -1, 1)) - edge)
            faults.expect(to_rim.min() > 0, f"the cut of {piece['name']} goes {-to_rim.min():.3f} mm into a dot")
            within = [points for points in sheet.areas if contains(loop, points.mean(axis=0)[None])[0]]
            faults.expect(len(within) == len(piece["dots"]), f"{len(within)} dots within {piece['name']}")
            seen += len(within)
            for points in within:
                faults.expect(contains(loop, points).all(), f"a dot leaves {piece['name']}")
                u, v, vectors = on_ball(points)
                found.append(vectors)
                # Area on the ball: cos(x/R) dx dy, by Green's theorem.
                m = radius**2 * np.sin(u)
                area = 0.5 * np.sum((m + np.roll(m, -1)) * (np.roll(v, -1) - v))
                areas[np.argmax(pattern @ vectors.mean(axis=0))] += abs(area)
    faults.expect(seen == sum(len(sheet.areas) for sheet in sheets), "a dot lies in no lobe")
    worst = check_rims(found, pattern, note, faults)
    share = areas / (2 * np.pi * radius**2 * (1 - np.cos(edge)))
    faults.expect(np.all(np.abs(share - 1) < 0.005), f"dots' areas: {share.min():.4f} to {share.max():.4f}")
    words = [w for sheet in sheets for w in sheet.words]
    check_numbers(words, 1, len(pattern), faults)
    check_free(sheets, faults)
    return worst


def check_stickers(note, sheets, pattern, faults, from_top):
    radius, turn = 0.5 * note["ball_diameter_mm"], rotation(note["rotation_pattern_to_mark"])
    found, singles = [], 0
    for index, sheet in enumerate(sheets):
        for points in sheet.areas:
            x, y = points.mean(axis=0)
            for place in note["maps"]:
                scale = radius * place["scale"]
                center = [place["x_mm"], from_top(sheet, place["from_top_mm"])]
                if place["page"] == index and np.hypot(x - center[0], y - center[1]) < scale * np.pi / 2 + 1:
                    sign = 1 if place["pole"] == "north" else -1
                    p, q = (points - center).T / scale
                    z = np.hypot(p, q)
                    r = np.sin(z) / np.maximum(z, 1e-12)
                    local = np.stack([p * r, sign * q * r, sign * np.cos(z)], 1)
                    found.append(local @ turn)
                    break
            else:
                singles += 1
                size = np.ptp(points, axis=0)
                off = np.abs(size - note["dot_diameter_mm"]).max()
                faults.expect(off < MOST_MM, f"a sticker measures {size[0]:.2f} x {size[1]:.2f} mm")
    faults.expect(singles == len(pattern), f"{singles} stickers")
    worst = check_rims(found, pattern, note, faults)
    words = [w for sheet in sheets for w in sheet.words]
    # Beneath its sticker, on the map, in the table.
    check_numbers(words, 3, len(pattern), faults)
    check_free(sheets, faults)
    return worst


def check_table(sheets, pattern, note, faults):
    """The table of a PDF: dot, latitude, longitude and three distances in each row."""
    text = "\n".join(sheet.text for sheet in sheets)
    names = [int(n) for n in re.findall(r"to dot (\d+), mm", text)]
    row = r"^\d+ -?\d+\.\d+ \d+\.\d+ \d+\.\d+ \d+\.\d+ \d+\.\d+$"
    for sheet in sheets:
        headed = re.search(r"^dot latitude, deg", sheet.text, re.M)
        faults.expect(headed or not re.search(row, sheet.text, re.M), "a part of the table has no heading")
    faults.expect(len(names) % 3 == 0 and names == names[:3] * (len(names) // 3), "the headings differ")
    names = names[:3]
    rows = re.findall(r"^(\d+) (-?\d+\.\d+) (\d+\.\d+) (\d+\.\d+) (\d+\.\d+) (\d+\.\d+)$", text, re.M)
    turned = pattern @ rotation(note["rotation_pattern_to_mark"]).T
    radius = 0.5 * note["ball_diameter_mm"]
    faults.expect(len(rows) == len(pattern) and len(names) == 3, f"the table has {len(rows)} rows")
    for row in rows:
        dot, latitude, longitude = int(row[0]), np.radians(float(row[1])), np.radians(float(row[2]))
        v = [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
        off = radius * np.linalg.norm(v - turned[dot])
        faults.expect(off < MOST_MM, f"the table's dot {dot} is off by {off:.3f} mm")
        for name, distance in zip(names, row[3:]):
            true = radius * np.linalg.norm(turned[dot] - turned[name])
            faults.expect(abs(true - float(distance)) < 0.01, f"the table's distance {dot} to {name} is wrong")


def check_paths(paths, pattern, note, faults):
    """`paths`: arrays of longitude and latitude, radians."""
    radius, pen = 0.5 * note["ball_diameter_mm"], note["pen_diameter_mm"]
    turn = rotation(note["rotation_pattern_to_mark"])
    drawn = [[] for _ in pattern]
    for path in paths:
        longitude, latitude = path.T
        v = np.stack([np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude),
                      np.sin(latitude)], 1) @ turn
        drawn[np.argmax(pattern @ v.mean(axis=0))].append(v)
    reach = np.arcsin((note["dot_diameter_mm"] - pen) / note["ball_diameter_mm"])
    rng, worst = np.random.default_rng(0), 0.0
    for dot, parts in enumerate(drawn):
        if not parts:
            faults.append(f"dot {dot} is missing")
            continue
        v = np.vstack(parts)
        angle = np.arccos(np.clip(v @ pattern[dot], -1, 1))
        rim = np.abs(angle - reach) * radius < MOST_MM
        faults.expect(angle.max() * radius < reach * radius + MOST_MM, f"dot {dot}: the pen leaves it")
        faults.expect(rim.sum() > 8, f"dot {dot}: the pen does not reach its rim")
        off = radius * np.arccos(np.clip(fitted_center(v[rim]) @ pattern[dot], -1, 1))
        worst = max(worst, off)
        faults.expect(off < MOST_MM, f"dot {dot} is off by {off:.3f} mm")
        # Ink: every point of the dot lies within half a pen's width of the path.
        e = np.linalg.svd(pattern[dot][None])[2][1:]
        full = np.arcsin(note["dot_diameter_mm"] / note["ball_diameter_mm"])
        r, t = full * np.sqrt(rng.random(300)), 2 * np.pi * rng.random(300)
        inside = np.cos(r)[:, None] * pattern[dot] + np.sin(r)[:, None] * (
            np.cos(t)[:, None] * e[0] + np.sin(t)[:, None] * e[1])
        ends = np.vstack([0.5 * (p[1:] + p[:-1]) for p in parts] + [v])
        gap = radius * np.min(np.linalg.norm(inside[:, None] - ends[None], axis=2), axis=1)
        faults.expect(gap.max() < 0.5 * pen + 0.1, f"dot {dot}: {gap.max():.2f} mm from the pen's path")
    return worst


class Gcode:
    """Runs G-code as GRBL does: absolute degrees, one pen, speed in units a minute."""

    def __init__(self, text, faults):
        self.note, self.paths, self.speeds = "", [], []
        position, feed, drawing = [0.0, 0.0], None, False
        for line in text.splitlines():
            words, _, comment = line.partition(";")
            if comment.startswith(" note "):
                self.note += comment[6:].split(" ", 1)[1]
            faults.expect(len(line) <= 80, f"a line of {len(line)} characters")
            codes = re.findall(r"([A-Z])(-?[\d.]+)", words)
            faults.expect("".join(a + b for a, b in codes) == words.replace(" ", ""), f"not understood: {line}")
            values = {a: float(b) for a, b in codes}
            if values.get("M") == 3:
                drawing = values["S"] == 90
                if drawing:
                    self.paths.append([list(position)])
            target = [values.get("X", position[0]), values.get("Y", position[1])]
            if "F" in values:
                feed = values["F"]
            if values.get("G") == 0:
                faults.expect(not drawing, f"the pen travels while it draws: {line}")
            elif values.get("G") == 1:
                faults.expect(drawing and feed, f"drawn without pen or speed: {line}")
                self.paths[-1].append(target)
                self.speeds.append((*position, *target, feed))
            position = target
        faults.expect(not drawing, "the pen stays down at the end")
        self.note = json.loads(self.note)
        self.paths = [np.radians(np.array(p)) for p in self.paths]

    def check_speed(self, faults):
        a, b, c, d, feed = np.array(self.speeds).T
        degrees = np.hypot(c - a, d - b)
        middle = np.cos(np.radians(0.5 * (b + d)))
        on_ball = 0.5 * self.note["ball_diameter_mm"] * np.radians(np.hypot((c - a) * middle, d - b))
        speed = feed * on_ball / degrees
        long = on_ball > 0.05
        faults.expect(np.ptp(speed[long]) < 0.05 * np.mean(speed[long]),
                      f"the pen's speed varies from {speed[long].min():.0f} to {speed[long].max():.0f} mm/min")


def check(path, pattern):
    """The faults of a file, its kind, and the maximum distance of a dot from its place, mm."""
    faults = Faults()
    if path.suffix == ".gcode":
        program = Gcode(path.read_text(), faults)
        program.check_speed(faults)
        note = program.note
        return faults, note, check_paths(program.paths, pattern, note, faults)
    note, sheets = {".svg": read_svg, ".pdf": read_pdf, ".dxf": read_dxf}[path.suffix](path, faults)
    faults.expect(note["dots"] == len(pattern), "the note has another number of dots")
    if note["kind"] == "gores":
        worst = check_gores(note, sheets, pattern, faults)
    elif note["kind"] == "stickers":
        # DXF has no page: its height is where the note and the topmost sticker agree.
        top = max(points[:, 1].max() for points in sheets[0].areas) + 10
        height = lambda sheet: sheet.size[1] or top
        worst = check_stickers(note, sheets, pattern, faults, lambda sheet, mm: height(sheet) - mm)
        if path.suffix == ".pdf":
            check_table(sheets, pattern, note, faults)
    else:
        steps = note["steps_per_turn"]
        faults.expect(sheets[0].size == (steps, steps / 2), "the plotter's page is not a turn wide")
        lines = [(p - [0, steps / 4]) * 2 * np.pi / steps for p in sheets[0].lines]
        faults.expect(all(p[:, 0].min() > -1e-6 and p[:, 0].max() < 2 * np.pi + 1e-6 for p in lines),
                      "a line leaves the page")
        worst = check_paths(lines, pattern, note, faults)
    if path.suffix == ".pdf":
        facts = (f"pattern {note['pattern_sha256'][:12]}; ball {note['ball_diameter_mm']:g} mm; "
                 f"{len(pattern)} dots of {note['dot_diameter_mm']:g} mm")
        for sheet in sheets:
            faults.expect(facts in sheet.text, "a sheet without a title block")
            sizes = [(210, 297), (215.9, 279.4)]
            near = min(max(abs(a - b) for a, b in zip(sheet.size, size)) for size in sizes)
            faults.expect(near < 0.01, f"a page of {sheet.size[0]:.2f} x {sheet.size[1]:.2f} mm")
            heights = [np.ptp(p[:, 1]) for p in sheet.lines if np.ptp(p[:, 0]) < 0.01]
            faults.expect(abs(max(heights, default=0) - 200) < 0.01, "the check line is not 200 mm long")
            for points in sheet.areas + sheet.loops:
                low, high = points.min(axis=0), points.max(axis=0)
                faults.expect(low[0] > 0 and low[1] > BLOCK_MM and (high < sheet.size).all(), "something leaves the page")
    return faults, note, worst


def main():
    if len(sys.argv) < 3:
        sys.exit("usage: check_marks.py PATTERN.csv FILE...")
    pattern, bad = read_pattern(sys.argv[1]), 0
    for name in sys.argv[2:]:
        faults, note, worst = check(Path(name), pattern)
        bad += bool(faults)
        print(f"{name}: {note['kind']}, ball of {note['ball_diameter_mm']} mm: dots off by at most {worst:.4f} mm")
        for fault in faults[:10]:
            print(f"  {fault}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
