"""A headless Chromium for the tests of the service's page; what goes wrong in its console fails the test."""

import base64
import time
from contextlib import contextmanager

from conftest import missing

PROGRAM = "/usr/bin/chromium"
# As root there is no sandbox; WebGL without a GPU; no traffic of its own.
FLAGS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-background-networking"]

# Text whose contrast to what lies behind it is below 4.5, or 3 where it is large (WCAG 2.1, 1.4.3), as [text, ratio].
PALE = """() => {
  const parse = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b].map((v) => v / 255)
    .map((v) => v <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const behind = (element) => {
    for (let at = element; at; at = at.parentElement) {
      const colour = parse(getComputedStyle(at).backgroundColor);
      if (colour.length === 3 || colour[3] === 1) return colour;
    }
    return [255, 255, 255];
  };
  const pale = [];
  for (const element of document.querySelectorAll("body *")) {
    const own = [...element.childNodes].some((node) => node.nodeType === 3 && node.textContent.trim());
    const style = getComputedStyle(element);
    if (!own || !element.checkVisibility() || element.disabled) continue;
    const [a, b] = [light(parse(style.color)), light(behind(element))].sort((x, y) => y - x);
    const ratio = (a + 0.05) / (b + 0.05);
    const large = parseFloat(style.fontSize) >= 24 || (parseFloat(style.fontSize) >= 18.66 && style.fontWeight >= 700);
    if (ratio < (large ? 3 : 4.5)) pale.push([element.textContent.slice(0, 40), ratio]);
  }
  return pale;
}"""

# Controls without a name, pictures without a text, ids that stand twice.
NAMELESS = """() => [
  ...[...document.querySelectorAll("input:not([hidden]), select, textarea")]
    .filter((e) => !e.labels?.length && !e.getAttribute("aria-label")).map((e) => e.outerHTML),
  ...[...document.querySelectorAll("button, a, summary")].filter((e) => !e.textContent.trim() && !e.ariaLabel)
    .map((e) => e.outerHTML),
  ...[...document.querySelectorAll("img")].filter((e) => !e.hasAttribute("alt")).map((e) => e.outerHTML),
  ...[...document.querySelectorAll("[id]")].map((e) => e.id).filter((id, i, all) => all.indexOf(id) !== i),
]"""


@contextmanager
def chromium():
    """A browser; skips by name where there is none."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        missing("chromium", f"{error}; pip install playwright")
    with sync_playwright() as player:
        try:
            browser = player.chromium.launch(executable_path=PROGRAM, args=FLAGS)
        except Error as error:
            missing("chromium", f"{PROGRAM}: {str(error).splitlines()[0]}")
        yield browser
        browser.close()


class Visit:
    """A page of its own, with nothing kept of others.

    Attributes:
        page: Playwright's.
        wrong: what the console said of errors.
    """

    def __init__(self, browser, served, token=None, size=(1100, 800), **context):
        self.served = served
        self._context = browser.new_context(viewport={"width": size[0], "height": size[1]}, **context)
        self._context.set_default_timeout(60_000)
        self.page = self._context.new_page()
        self.wrong = []
        self.page.on("pageerror", lambda error: self.wrong.append(str(error)))
        self.page.on("console", lambda said: self.wrong.append(said.text) if said.type == "error" else None)
        token = served.token if token is None else token
        self.page.goto(f"{served.url}/#token={token}" if token else f"{served.url}/")

    def close(self):
        self._context.close()

    def until(self, expression, seconds=60):
        """Wait until this is true on the page; Playwright's own way needs eval, which the page's policy forbids."""
        end = time.monotonic() + seconds
        while not self.page.evaluate(expression):
            assert time.monotonic() < end, f"after {seconds} s still not: {expression}"
            self.page.wait_for_timeout(50)

    def fill(self, folder, left="left.png", right="right.png"):
        """Choose the pair of `raw_folder` and a rig of its size; where there is none, send the folder's."""
        self.page.get_by_label("Left picture").set_input_files(folder / left)
        self.page.get_by_label("Right picture").set_input_files(folder / right)
        rigs = self.page.get_by_label("Rig", exact=True)
        self.until("document.querySelector('select').options.length > 0")
        if rigs.input_value() == "":
            fitting = rigs.locator("option", has_text="320 × 240")  # others may be of a test that ran before
            if fitting.count():
                rigs.select_option(value=fitting.first.get_attribute("value"))
            else:
                self.page.get_by_label("Or send the file of one").set_input_files(folder / "rig.json")
        self.until("document.querySelector('select').value !== ''")

    def drop(self, *files):
        """Drop files on the place for the pair."""
        given = [[file.name, base64.b64encode(file.read_bytes()).decode()] for file in files]
        dropped = self.page.evaluate_handle(
            "(given) => given.reduce((all, [name, data]) => {"
            " const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));"
            " all.items.add(new File([bytes], name)); return all; }, new DataTransfer())",
            given,
        )
        self.page.locator(".pair").dispatch_event("drop", {"dataTransfer": dropped})

    def fast(self):
        """Options that take little time at 320 x 240."""
        self.page.get_by_label("Quality").select_option("fast")
        self.page.get_by_label("Files").select_option("model")
        self.page.get_by_text("More options").click()
        self.page.get_by_label("Smallest disparity").fill("22")
        self.page.get_by_label("How many disparities").fill("40")

    def start(self):
        """Press Start; gives the id of the job."""
        self.page.get_by_role("button", name="Start", exact=True).click()
        self.page.wait_for_url("**/#/jobs/*")
        return self.page.url.rpartition("/")[2]

    def wait_for_state(self, state):
        self.page.wait_for_selector(f".state[data-state={state}]")

    def drag(self, start, end, steps=4):
        """Draw on the painter's canvas, in parts of its width and height."""
        box = self.page.locator("canvas").bounding_box()
        at = [(box["x"] + x * box["width"], box["y"] + y * box["height"]) for x, y in (start, end)]
        self.page.mouse.move(*at[0])
        self.page.mouse.down()
        self.page.mouse.move(*at[1], steps=steps)
        self.page.mouse.up()
