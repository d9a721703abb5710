"""Opens pages of spindoe in headless Chromium and uses them as a person would.

    python3 python/check_page.py PAGE.html... [--shots DIR]

Needs the Python package `playwright` and a Chromium: the system's (`chromium` on PATH) or Playwright's own. Where
one is absent it says SKIPPED and exits with 77. Prints one line a check; exits with 1 where one fails.
"""

import argparse
import base64
import hashlib
import json
import pathlib
import shutil
import sys

SKIPPED = 77
MAX_BYTES = 6_000_000
TIMEOUT_MS = 240_000
REACHED = {"A", "BUTTON", "CANVAS"}


def skip(why):
    print(f"SKIPPED: {why}")
    sys.exit(SKIPPED)


class Checks:
    def __init__(self):
        self.failed = 0

    def that(self, held, what):
        print(("ok      " if held else "FAILED  ") + what)
        self.failed += not held


def picture(page, selector):
    return hashlib.sha256(page.locator(selector).first.screenshot()).hexdigest()


def turn(page):
    return page.locator("canvas.view").first.get_attribute("data-turn")


def settle(page):
    page.evaluate("() => new Promise((r) => requestAnimationFrame(() => requestAnimationFrame(r)))")


def open_page(browser, path, checks, **options):
    context = browser.new_context(**options)
    # Software rendering on a busy machine is slow; nothing here depends on speed.
    context.set_default_timeout(TIMEOUT_MS)
    page = context.new_page()
    complaints = []
    # A driver's remark on speed is about the browser without a graphics card.
    page.on("console", lambda m: m.type in ("error", "warning") and "GL Driver Message (OpenGL, Performance" not in m.text and complaints.append(m.text))
    page.on("pageerror", lambda e: complaints.append(str(e)))
    requests = []
    page.on("request", lambda r: requests.append(r.url))
    page.goto(path.resolve().as_uri())
    page.wait_for_selector("html[data-ready=true]", timeout=TIMEOUT_MS)
    settle(page)
    outside = [u for u in requests if not u.startswith(("file:", "data:", "blob:"))]
    checks.that(not outside, f"asks for nothing outside the file {outside[:2]}")
    return page, complaints


def shoot(page, shots, name):
    if shots:
        page.screenshot(path=shots / f"{name}.png", full_page=True)


def turns(page, checks):
    """Drag, keys, zoom and reset of the first view."""
    view = page.locator("canvas.view").first
    view.scroll_into_view_if_needed()
    settle(page)
    first, drawn = turn(page), picture(page, "canvas.view")
    box = view.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 90, y + 35, steps=2)
    page.mouse.up()
    settle(page)
    checks.that(turn(page) != first, "a drag turns the ball")
    checks.that(picture(page, "canvas.view") != drawn, "the turned ball looks different")
    view.focus()
    page.keyboard.press("Home")
    settle(page)
    checks.that(turn(page) == first, "Home resets it")
    page.keyboard.press("ArrowRight")
    settle(page)
    checks.that(turn(page) != first, "an arrow key turns it")
    before = picture(page, "canvas.view")
    page.keyboard.press("+")
    settle(page)
    checks.that(picture(page, "canvas.view") != before, "+ zooms")
    page.keyboard.press("Home")
    settle(page)


def drawn_colors(page, selector):
    """How many different colors a canvas shows: an empty one has few."""
    return page.locator(selector).first.evaluate(
        """(c) => { const k = document.createElement("canvas"); k.width = c.width; k.height = c.height;
        const g = k.getContext("2d"); g.drawImage(c, 0, 0); const d = g.getImageData(0, 0, k.width, k.height).data;
        const s = new Set(); for (let i = 0; i < d.length; i += 4 * 37) s.add((d[i] << 16) | (d[i + 1] << 8) | d[i + 2]); return s.size; }"""
    )


def check_design(page, checks, data):
    content = data["content"]
    rows = page.locator("#dots tbody tr").count()
    checks.that(rows == len(content["dots"]), f"the table has all {rows} dots")
    view = page.locator("#ball canvas.view")
    view.focus()
    page.keyboard.press("n")
    settle(page)
    words = page.locator("#dot-info").inner_text()
    checks.that(words.startswith("dot 0"), "N chooses a dot and names it")
    before = picture(page, "#ball canvas.view")
    page.locator("#ball .controls label", has_text="numbers").locator("input").uncheck()
    settle(page)
    checks.that(picture(page, "#ball .stage") != before, "numbers can be switched off")
    page.locator("#ball .controls label", has_text="numbers").locator("input").check()
    # The dot that faces the viewer is found by the pointer.
    settle(page)
    box = view.bounding_box()
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    settle(page)
    tip = page.locator("#tip")
    checks.that(tip.is_visible() and tip.inner_text().startswith("dot 0"), "hovering the facing dot shows its tip")
    page.mouse.move(2, 2)
    if content["stencil"]:
        before = picture(page, "#stencil canvas.view")
        page.locator("#swing").click()
        page.wait_for_function("() => document.querySelector('#stencil output').textContent === '110°'")
        settle(page)
        checks.that(page.locator("#stencil output").inner_text() == "110°", "the stencil opens")
        checks.that(picture(page, "#stencil canvas.view") != before, "the open stencil looks different")
        checks.that(drawn_colors(page, "#stencil canvas.view") > 300, "the stencil is shaded")
    if content["validation"]:
        rates = {(v["recognizer"], v["protocol"]): v for v in content["validation"]}
        shown = page.locator("#rates figure details").first
        shown.locator("summary").click()
        words = shown.inner_text()
        rate = rates[("robust", "sparse")]["answered"]
        checks.that(f"{rate['trials']}" in words, "rates are there as a table with their trials")
        chart = page.locator("#rates svg").first
        chart.focus()
        page.keyboard.press("ArrowRight")
        checks.that("trials" in tip.inner_text(), "arrow keys read the chart")
        page.keyboard.press("Escape")
    if content["sensitivity"]:
        mark = page.locator("#sensitivity line.mark").first
        at = mark.get_attribute("x1")
        page.locator("#camera-pixels").fill("40")
        settle(page)
        moved = page.locator("#sensitivity line.mark").first.get_attribute("x1")
        checks.that(float(moved) > float(at), "a smaller ball moves the mark to more noise")
    # The closed form, computed anew.
    import math

    page.locator("#camera-pixels").fill("60")
    page.locator("#camera-noise").fill("1")
    page.locator("#camera-rate").fill("350")
    page.locator("#camera-frames").fill("10")
    settle(page)
    sigma = 1 / 30
    error = content["bound"]["mean"] * sigma
    times = [k / 350 for k in range(10)]
    mean = sum(times) / 10
    spin = error / math.sqrt(sum((t - mean) ** 2 for t in times)) / (2 * math.pi)
    words = page.locator("#camera-figures").inner_text()
    expected = [f"{math.degrees(error):.2f}°", f"{spin:.3f}", "175 rps"]
    checks.that(all(e in words for e in expected), f"camera figures are {expected}")


def check_compare(page, checks, data):
    count = len(data["content"]["patterns"])
    checks.that(page.locator("#balls canvas.view").count() == count, f"there are {count} balls")
    both = [page.locator("#balls canvas.view").nth(k).get_attribute("data-turn") for k in range(count)]
    checks.that(len(set(both)) == 1, "all balls stand alike")


def check_estimate(page, checks, data):
    for ball in data["content"]["balls"]:
        part = "" if ball["number"] is None else f"ball-{ball['number']}-"
        check_ball(page, checks, part, ball["frames"])
        if ball["paint"]:
            check_paint(page, checks, part, ball)


def check_paint(page, checks, part, ball):
    """The ball's surface is drawn on it, and what is said of frames is of paint."""
    values = base64.b64decode(ball["paint"]["values"])
    checks.that(len(values) == ball["paint"]["columns"] * ball["paint"]["rows"], "the surface has all its values")
    # Painted over with one shade the ball looks different: its surface is what is drawn.
    before = picture(page, f"#{part}ball canvas.view")
    draw = f"document.querySelector('#{part}ball input[type=range]').dispatchEvent(new Event('input'))"
    page.evaluate(
        """() => { const own = (Stage.prototype.own = Stage.prototype.texture);
        const bare = (p) => p && { ...p, values: btoa("\\xff".repeat(p.columns * p.rows)) };
        Stage.prototype.texture = function (p) { return own.call(this, bare(p)); }; }"""
    )
    page.evaluate(draw)
    settle(page)
    checks.that(picture(page, f"#{part}ball canvas.view") != before, "the ball shows its surface")
    page.evaluate("() => { Stage.prototype.texture = Stage.prototype.own; }")
    page.evaluate(draw)
    settle(page)
    checks.that(picture(page, f"#{part}ball canvas.view") == before, "and again")
    words = page.locator(f"#{part}ball pre").inner_text()
    checks.that("agreement" in words and "dots" not in words, "a frame says how well it agrees with the surface")


def check_ball(page, checks, part, frames):
    """A ball of an estimate: its sections have ids that begin with `part`."""
    slider = page.locator(f"#{part}ball input[type=range]")
    before = picture(page, f"#{part}ball canvas.view")
    slider.focus()
    page.keyboard.press("End")
    settle(page)
    checks.that(picture(page, f"#{part}ball canvas.view") != before, "the slider shows another frame")
    checks.that(frames[-1]["name"] in page.locator(f"#{part}ball pre").inner_text(), "and names it")
    # Back to a frame with an orientation, which the print shows.
    page.keyboard.press("Home")
    settle(page)
    rejected = [f for f in frames if f["rejection"]]
    words = page.locator(f"#{part}rejected").inner_text()
    checks.that(all(f["rejection_kind"] in words for f in rejected), f"reasons of {len(rejected)} rejected frames")


def check_calibrate(page, checks, data):
    content = data["content"]
    dots = content["dots"]
    checks.that(page.locator("#dots tbody tr").count() == len(dots), f"the table has all {len(dots)} dots")
    view = page.locator("#ball canvas.view")
    view.focus()
    page.keyboard.press("n")
    settle(page)
    words = page.locator("#dot-info").inner_text()
    checks.that(words.startswith(f"dot {dots[0]['nominal_number']}"), "N chooses a dot and names it")
    before = picture(page, "#ball canvas.view")
    page.locator("#ball input[type=range]").focus()
    page.keyboard.press("End")
    settle(page)
    checks.that(picture(page, "#ball canvas.view") != before, "the slider enlarges the offsets")
    page.keyboard.press("Home")
    # Offsets by compass, computed anew: their length is the angle between nominal and drawn.
    import math

    worst = 0.0
    for dot, compass in zip(dots, content["compass_deg"]):
        cosine = sum(a * b for a, b in zip(dot["nominal"], dot["drawn"]))
        sine = math.degrees(math.sqrt(max(0.0, 1.0 - min(1.0, cosine) ** 2)))
        worst = max(worst, abs(math.hypot(*compass) - sine))
    checks.that(worst < 1e-3, f"offsets to north and east have the offsets' lengths ({worst:.1e} degrees off)")
    for state in ("missing", "unseen"):
        numbers = [str(d["nominal_number"]) for d in dots if d["state"] == state]
        tiles = page.locator(".tiles").inner_text()
        checks.that(not numbers or ", ".join(numbers) in tiles, f"{state} dots {numbers} are named at the top")
    if content["held_out"]["frames"]:
        median = content["held_out"]["median_deg"][1]
        checks.that(f"{median:.2f}°" in page.locator("#residuals").inner_text(), "the residual of its own table is there")
    advice = page.locator("#advice li").all_inner_texts()
    checks.that(advice == content["advice"], f"{len(advice)} lines of advice")


def check_print(page, checks, path, shots):
    pdf = page.pdf(format="A4", print_background=True, prefer_css_page_size=True)
    if shots:
        (shots / f"{path.parent.name}_{path.stem}.pdf").write_bytes(pdf)
    try:
        import io

        import pdfplumber
    except ImportError:
        print("SKIPPED: pages of the print are not examined without pdfplumber")
        return
    heads = page.locator("h2").all_inner_texts()
    with pdfplumber.open(io.BytesIO(pdf)) as document:
        sizes = {(round(p.width), round(p.height)) for p in document.pages}
        words = " ".join(p.extract_text() or "" for p in document.pages)
        empty = [p.page_number for p in document.pages if len(p.chars) < 5 and not p.images]
        cut = [
            p.page_number
            for p in document.pages
            for image in p.images
            if image["top"] < -1 or image["bottom"] > p.height + 1 or image["x1"] > p.width + 1
        ]
        # The stage's background with a ball in it: what is blank on paper would be white only.
        sheets = [p.to_image(resolution=50).original.convert("RGB") for p in document.pages]
        warm = sum(n for sheet in sheets for n, c in sheet.getcolors(1 << 20) if 120 < c[0] and 8 < c[0] - c[2] < 60)
    checks.that(warm > 4000, f"the ball is on paper ({warm} pixels of its color)")
    checks.that(sizes == {(595, 842)}, f"the print has whole A4 pages {sizes}")
    squeezed = "".join(words.split())
    checks.that(all("".join(h.split()) in squeezed for h in heads), "every section is printed")
    checks.that(not empty and not cut, f"no page is empty {empty}, no picture is cut {cut}")


def check(browser, path, shots, checks):
    print(path)
    checks.that(path.stat().st_size <= MAX_BYTES, f"{path.stat().st_size} bytes, at most {MAX_BYTES}")
    name = f"{path.parent.name}_{path.stem}"
    # A quarter of the pixels a side: the views are drawn by software.
    page, complaints = open_page(browser, path, checks, viewport={"width": 1280, "height": 900}, device_scale_factor=0.25)
    data = json.loads(page.locator("#data").text_content())
    checks.that(drawn_colors(page, "canvas.view") > 100, "the ball is drawn")
    shoot(page, shots, f"{name}_light")
    turns(page, checks)
    {"design": check_design, "compare": check_compare, "estimate": check_estimate, "calibrate": check_calibrate}[data["kind"]](page, checks, data)
    paper = page.evaluate("() => getComputedStyle(document.body).backgroundColor")
    page.locator("#theme").click()
    settle(page)
    checks.that(page.evaluate("() => getComputedStyle(document.body).backgroundColor") != paper, "the theme can be switched")
    shoot(page, shots, f"{name}_dark")
    reached = set()
    page.locator("body").click(position={"x": 3, "y": 3})
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("() => document.activeElement.tagName"))
        if REACHED <= reached:
            break
    checks.that(REACHED <= reached, f"links, buttons and views are reached by Tab: {sorted(reached)}")
    check_print(page, checks, path, shots)
    checks.that(not complaints, f"no complaint in the console {complaints[:3]}")
    page.context.close()
    page, complaints = open_page(
        browser, path, checks, viewport={"width": 390, "height": 844}, device_scale_factor=0.25, has_touch=True, is_mobile=True
    )
    wide = page.evaluate("() => document.documentElement.scrollWidth")
    checks.that(wide <= 390, f"nothing is wider than a phone of 390 px ({wide})")
    shoot(page, shots, f"{name}_phone")
    before = turn(page)
    view = page.locator("canvas.view").first
    view.scroll_into_view_if_needed()
    view.evaluate(
        """(c) => { const b = c.getBoundingClientRect(), x = b.x + b.width / 2, y = b.y + b.height / 2;
        const send = (type, dx) => c.dispatchEvent(new PointerEvent(type, { pointerId: 1, pointerType: "touch", isPrimary: true, clientX: x + dx, clientY: y, bubbles: true }));
        c.setPointerCapture = () => {}; send("pointerdown", 0); send("pointermove", 30); send("pointermove", 70); send("pointerup", 70); }"""
    )
    settle(page)
    checks.that(turn(page) != before, "a finger turns the ball")
    checks.that(not complaints, f"no complaint in the console of the phone {complaints[:3]}")
    page.context.close()


def check_dark(browser, path, checks):
    """A theme is chosen by what all pages share: one page shows it."""
    dark, _ = open_page(browser, path, checks, viewport={"width": 900, "height": 700}, color_scheme="dark")
    theme = dark.evaluate("() => document.documentElement.dataset.theme")
    checks.that(theme == "dark", "a dark system gets a dark page")
    dark.context.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pages", nargs="+", type=pathlib.Path)
    parser.add_argument("--shots", type=pathlib.Path, default=None)
    arguments = parser.parse_args()
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError:
        skip("the Python package playwright is absent")
    shots = arguments.shots
    if shots:
        shots.mkdir(parents=True, exist_ok=True)
    checks = Checks()
    with sync_playwright() as playwright:
        own = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
        # Only the views are drawn through WebGL, by software; the page itself takes a third less time without it.
        flags = ["--no-sandbox", "--enable-unsafe-swiftshader", "--use-angle=swiftshader", "--ignore-gpu-blocklist", "--disable-gpu-compositing"]
        try:
            browser = playwright.chromium.launch(executable_path=own, args=flags)
        except Error as error:
            skip(f"no Chromium can be started: {str(error).splitlines()[0]}")
        for path in arguments.pages:
            check(browser, path, shots, checks)
        check_dark(browser, arguments.pages[0], checks)
        browser.close()
    sys.exit(1 if checks.failed else 0)


if __name__ == "__main__":
    main()
