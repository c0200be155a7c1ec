"""Painting on the page, by pointer, by finger and by keys; and that every view can be read, reached and named."""

import re

import cv2
import numpy as np
import pytest
from browsing import NAMELESS, PALE

PHONE = {"size": (360, 740), "has_touch": True, "is_mobile": True}
OBJECT = (0.35, 0.2), (0.8, 0.85)  # around the bear


def test_what_is_painted_is_what_is_reconstructed(visit, owner, raw_folder):
    here = visit()
    here.fill(raw_folder)
    here.fast()
    page = here.page
    page.get_by_role("button", name="Paint the object").click()
    page.wait_for_selector("canvas")
    told = page.locator("#paint-told")
    page.locator("canvas").scroll_into_view_if_needed()

    def share(before=""):
        here.until(
            "(() => { const told = document.getElementById('paint-told').textContent;"
            f" return told.includes('holds') && told !== '{before}'; }})()"
        )
        return told.text_content()

    here.drag(*OBJECT)
    cut = share()
    page.get_by_label("Brush: wanted", exact=True).check()
    here.drag((0.1, 0.9), (0.3, 0.9))
    more = share(cut)
    page.get_by_label("Brush: not wanted").check()
    here.drag((0.1, 0.9), (0.3, 0.9))
    less = share(more)
    page.get_by_role("button", name="Undo").click()
    assert share(less) == more, "undo gives another outline than there was"
    page.keyboard.press("Tab")
    page.locator("canvas").focus()
    page.keyboard.press("Control+z")
    assert share(more) == cut

    names = ("Left edge", "Top edge", "Width", "Height")
    x, y, width, height = (int(page.get_by_label(f"{name}, px", exact=True).input_value()) for name in names)
    (left, top), (right, bottom) = OBJECT
    drawn = np.multiply((left, top, right - left, bottom - top), (320, 240, 320, 240))
    assert np.abs(np.subtract((x, y, width, height), drawn)).max() <= 1
    job = here.start()
    here.wait_for_state("done")
    view = owner.get(f"/v1/jobs/{job}").json()
    sent = next(file for file in view["inputs"] if file["name"].startswith("mask"))
    mask = cv2.imdecode(np.frombuffer(owner.get(sent["href"]).content, np.uint8), 0)
    assert mask.shape == (240, 320) and set(np.unique(mask)) == {0, 255}
    assert float(re.search(r"[\d.]+", cut)[0]) == pytest.approx(100 * (mask > 0).mean(), abs=0.51)
    outside = mask.copy()
    outside[y : y + height, x : x + width] = 0
    assert not outside.any() and (mask > 0).mean() > 0.05


def test_everything_can_be_done_by_keys(visit, raw_folder, done):
    here = visit()
    page = here.page
    choosers = []
    # Long before the first one: it takes the browser a moment to heed this.
    page.on("filechooser", lambda chooser: choosers.append(chooser))
    here.until("document.querySelector('select').options.length > 1")

    def tab_to(name):
        for _ in range(60):
            page.keyboard.press("Tab")
            found = page.evaluate(
                "() => { const e = document.activeElement;"
                " return e.labels?.[0]?.textContent ?? e.getAttribute('aria-label') ?? e.textContent; }"
            )
            if found.strip().startswith(name):
                outline = page.evaluate("getComputedStyle(document.activeElement).outlineStyle")
                assert outline != "none", f"nothing shows that {name} has the focus"
                return
        raise AssertionError(f"no way to {name} by Tab")

    for wanted, side in enumerate(("Left", "Right"), 1):
        tab_to(f"{side} picture")
        page.keyboard.press("Space")
        for _ in range(500):
            if len(choosers) < wanted:
                page.wait_for_timeout(20)
        choosers[-1].set_files(raw_folder / f"{side.lower()}.png")
    tab_to("Rig")
    if not page.get_by_label("Rig", exact=True).input_value():
        page.keyboard.press("ArrowDown")
    tab_to("Paint the object")
    page.keyboard.press("Enter")
    page.wait_for_selector("canvas")
    tab_to("The rectified picture")
    for key in ["Shift+ArrowLeft"] * 3 + ["Shift+ArrowUp"] * 5 + ["Enter"] + ["Shift+ArrowRight"] * 9:
        page.keyboard.press(key)
    for key in ["Shift+ArrowDown"] * 10 + ["Enter"]:
        page.keyboard.press(key)
    page.get_by_text("The outline holds").wait_for()
    tab_to("Quality")
    page.keyboard.press("ArrowDown")
    tab_to("Start")
    page.keyboard.press("Enter")
    page.wait_for_url("**/#/jobs/*")
    here.wait_for_state("done")
    assert page.evaluate("document.activeElement.tagName") == "H1", "the new view does not get the focus"
    page.wait_for_selector(".stage canvas")
    tab_to("The model")
    page.keyboard.press("ArrowUp")
    tab_to("Download model.glb")
    with page.expect_download():
        page.keyboard.press("Enter")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_every_view_fits_a_phone_can_be_read_and_has_names(visit, served, raw_folder, done, scheme):
    here = visit(**PHONE, color_scheme=scheme, reduced_motion="reduce")
    page = here.page
    here.fill(raw_folder)
    page.get_by_role("button", name="Paint the object").click()
    page.wait_for_selector("canvas")
    page.get_by_text("More options").click()

    def look(view):
        assert page.evaluate("document.documentElement.scrollWidth") <= 360, f"{view} is too wide"
        assert page.evaluate(PALE) == [], view
        assert page.evaluate(NAMELESS) == [], view
        small = "[...document.querySelectorAll('button, select, .button, nav a')].filter((e) => e.checkVisibility()"
        assert page.evaluate(f"{small} && e.getBoundingClientRect().height < 40).map((e) => e.textContent)") == [], view

    look("new")
    # One finger draws, and does not scroll.
    box = page.locator("canvas").bounding_box()
    page.locator("canvas").scroll_into_view_if_needed()
    box = page.locator("canvas").bounding_box()
    finger = page.context.new_cdp_session(page)
    for kind, at in [("touchStart", 0.2), ("touchMove", 0.5), ("touchMove", 0.85), ("touchEnd", None)]:
        places = [] if at is None else [{"x": box["x"] + at * box["width"], "y": box["y"] + at * box["height"]}]
        finger.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": places})
    page.get_by_text("The outline holds").wait_for()
    for view in ("jobs", f"jobs/{done['id']}", "calibrate"):
        page.goto(f"{served.url}/#/{view}")
        page.wait_for_selector({"jobs": ".grid li", "calibrate": "form"}.get(view, ".files tr"))
        look(view)
