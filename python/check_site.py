"""Opens every page of the built site in headless Chromium: no console error, no broken link or picture, search finds words; and
the reference lists every public name of the Python package.

    mkdocs build -d site && python3 python/check_site.py site

Needs the Python package `playwright` and a Chromium, as check_page.py does. Where one is absent it says SKIPPED and exits
with 77. Prints one line a page; exits with 1 where one fails.
"""

import ast
import functools
import http.server
import pathlib
import re
import shutil
import sys
import threading
from urllib.parse import urldefrag, urljoin

from check_page import Checks, skip

TIMEOUT_MS = 60_000
#: A word of the documents and a page that search must name for it.
FOUND = {"stencil": "stencil/", "covariance": "measurements/"}


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        pass


def serve(folder):
    """The site's address, while this program runs."""
    handler = functools.partial(Quiet, directory=str(folder))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_address[1]}/"


def check_pages(page, start, checks):
    """Follows all links from the first page."""
    complaints, missing = [], []
    page.on("console", lambda m: m.type == "error" and complaints.append(m.text))
    page.on("pageerror", lambda e: complaints.append(str(e)))
    page.on("response", lambda r: r.status >= 400 and missing.append(r.url))
    # A page that is left before its search's worker has come aborts that request: no fault of either page.
    page.on("requestfailed", lambda r: r.url.startswith(start) and r.failure != "net::ERR_ABORTED" and missing.append(r.url))
    waiting, seen = [start], set()
    while waiting:
        url = waiting.pop()
        if url in seen:
            continue
        seen.add(url)
        complaints.clear()
        missing.clear()
        page.goto(url, wait_until="load")
        links = page.eval_on_selector_all("a[href]", "all => all.map((a) => a.getAttribute('href'))")
        for link in links:
            target, anchor = urldefrag(urljoin(url, link))
            if target == url and anchor and page.query_selector(f"[id='{anchor}']") is None:
                missing.append(f"#{anchor}")
            if target.startswith(start) and target.endswith("/"):
                waiting.append(target)
        name = url[len(start):] or "index"
        checks.that(not complaints and not missing, f"{name}: {len(links)} links {complaints[:2]} {missing[:2]}")
    return len(seen)


def check_search(page, start, checks):
    for word, expected in FOUND.items():
        page.goto(start, wait_until="load")
        page.keyboard.press("/")
        page.keyboard.type(word)
        page.wait_for_selector(".md-search-result__link", timeout=TIMEOUT_MS)
        links = page.eval_on_selector_all(".md-search-result__link", "all => all.map((a) => a.href)")
        checks.that(any(expected in link for link in links), f"search for {word}: {len(links)} results")


def public_names(package):
    """What the package exports, and the functions and classes of its public modules."""
    for path in sorted(package.glob("[!_]*.py")):
        for node in ast.parse(path.read_text()).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                yield f"spindoe.{path.stem}.{node.name}"
    for node in ast.parse((package / "__init__.py").read_text()).body:
        if isinstance(node, ast.Assign) and node.targets[0].id == "__all__":
            yield from (f"spindoe.{name}" for name in ast.literal_eval(node.value))


def check_reference(site, checks):
    """The reference has an entry for every public name of the Python package."""
    entries = set(re.findall(r'id="([^"]+)"', (site / "reference/python/index.html").read_text()))
    names = list(public_names(pathlib.Path(__file__).parent / "spindoe"))
    missing = [name for name in names if name not in entries]
    checks.that(len(names) > 50 and not missing, f"reference: {len(names)} names {missing[:5]}")


def main():
    if len(sys.argv) != 2 or not pathlib.Path(sys.argv[1], "index.html").is_file():
        sys.exit("usage: check_site.py SITE, a folder that `mkdocs build -d SITE` wrote")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        skip("the Python package playwright is not installed")
    chromium = shutil.which("chromium")
    if chromium is None:
        skip("there is no chromium")
    checks = Checks()
    check_reference(pathlib.Path(sys.argv[1]), checks)
    start = serve(sys.argv[1])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        pages = check_pages(page, start, checks)
        checks.that(pages >= 20, f"{pages} pages")
        check_search(page, start, checks)
        browser.close()
    sys.exit(1 if checks.failed else 0)


if __name__ == "__main__":
    main()
