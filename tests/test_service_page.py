"""The page in a real browser, with a real service and a real worker behind it."""

import hashlib
import re

import cv2
import numpy as np
import pytest
from browsing import Visit


def test_a_pair_becomes_a_model_to_turn_and_to_download(visit, owner, raw_folder, tmp_path):
    here = visit()
    assert here.page.evaluate("location.hash") == "#/new", "the token stays in the address"
    here.fill(raw_folder)
    here.fast()
    here.page.get_by_label("Name of the job").fill("cup")
    job = here.start()
    here.wait_for_state("done")
    page = here.page
    page.wait_for_selector(".stage canvas")
    assert page.get_by_role("heading", name="cup").is_visible() and page.title().startswith("done: cup")
    steps = page.locator("section", has=page.get_by_role("heading", name="Steps")).locator("img")
    assert steps.count() == 5
    here.until("[...document.querySelectorAll('figure img')].slice(0, 5).every((image) => image.naturalWidth)")
    assert page.locator(".stages li[data-at=done]").count() == len(owner.get(f"/v1/jobs/{job}").json()["stages"])

    canvas = page.locator(".stage canvas")
    front = canvas.screenshot()
    assert np.asarray(cv2.imdecode(np.frombuffer(front, np.uint8), 1)).std() > 20, "nothing is drawn"
    canvas.focus()
    page.keyboard.press("ArrowRight")
    page.wait_for_timeout(100)
    turned = canvas.screenshot()
    assert turned != front
    page.get_by_role("button", name="Shape").click()
    page.wait_for_timeout(100)
    assert canvas.screenshot() != turned
    assert page.get_by_role("button", name="Shape").get_attribute("aria-pressed") == "true"

    with page.expect_download() as coming:
        page.get_by_role("button", name="Download model.glb").click()
    assert coming.value.suggested_filename == "cup_model.glb"
    coming.value.save_as(tmp_path / "model.glb")
    known = {file["name"]: file["sha256"] for file in owner.get(f"/v1/jobs/{job}/files").json()["items"]}
    assert hashlib.sha256((tmp_path / "model.glb").read_bytes()).hexdigest() == known["model.glb"]


def test_a_job_is_cancelled_started_again_and_deleted(visit, owner, raw_folder, done):
    from serving import post_pair

    slow = {"profile": "precise", "files": "all"}
    ahead = [post_pair(owner, raw_folder, done["rig"], slow).json()["id"] for _ in range(3)]  # it waits behind these
    here = visit()
    page = here.page
    here.drop(raw_folder / "right.png", raw_folder / "left.png")
    shown = [slot.text_content() for slot in page.locator(".slot .name").all()]
    assert shown[0].startswith("left.png, ") and shown[1].startswith("right.png, "), "names do not tell the sides"
    here.until("document.querySelector('select').options.length > 1")
    page.get_by_label("Rig", exact=True).select_option(done["rig"])
    here.fast()
    job = here.start()
    page.get_by_role("button", name="Cancel").click()
    here.wait_for_state("cancelled")
    assert owner.get(f"/v1/jobs/{job}").json()["state"] == "cancelled"
    for each in ahead:
        owner.post(f"/v1/jobs/{each}/cancel")
    page.get_by_role("button", name="Start again").click()
    here.wait_for_state("done")
    page.once("dialog", lambda asked: asked.accept())
    page.get_by_role("button", name="Delete").click()
    page.wait_for_url("**/#/jobs")
    assert owner.get(f"/v1/jobs/{job}").status_code == 404


def test_a_wrong_file_is_refused_in_one_line_and_nothing_is_lost(visit, served, raw_folder, tmp_path):
    (tmp_path / "left.png").write_text("no picture")
    here = visit()
    page = here.page
    page.get_by_role("button", name="Start", exact=True).click()
    alert = page.locator("form > [role=alert]")
    assert alert.text_content().startswith("Choose the left picture and the right picture")
    here.fill(raw_folder)
    page.get_by_label("Left picture").set_input_files(tmp_path / "left.png")
    here.fast()
    page.get_by_label("Name of the job").fill("kept")
    page.get_by_role("button", name="Start", exact=True).click()
    here.until("/left/.test(document.querySelector('form > [role=alert]').textContent)")
    assert "\n" not in alert.text_content() and alert.is_visible()
    page.get_by_label("Window, px").fill("4")
    page.get_by_label("Left picture").set_input_files(raw_folder / "left.png")
    page.get_by_role("button", name="Start", exact=True).click()
    here.until("/window/.test(document.querySelector('form > [role=alert]').textContent)")
    page.get_by_label("Or send the file of one").set_input_files(tmp_path / "left.png")
    page.get_by_text("left.png: ").first.wait_for()
    page.get_by_label("Window, px").fill("")
    assert page.get_by_label("Name of the job").input_value() == "kept"
    here.start()
    here.wait_for_state("done")
    # What the service refused stands in the console, too, and is the only thing there.
    assert all("422" in line for line in here.wrong) and len(here.wrong) == 3
    here.wrong.clear()


# FastAPI hushes this while it makes an app, and Python's filters are one for all threads: the inline engine's, which
# has begun with the job again by then, may undo that amid it.
@pytest.mark.filterwarnings("ignore:The 'alias' attribute")
def test_a_lost_connection_comes_back_by_itself(browser, raw_folder, tmp_path):
    from serving import add_rig, post_pair, serving

    with serving(tmp_path / "data", engine="inline") as service, service.client() as client:
        rig = add_rig(client, raw_folder)
        # It waits behind these: what has ended asks the service nothing, and so does not miss it.
        ahead = [post_pair(client, raw_folder, rig, {"profile": "precise"}).json()["id"] for _ in range(2)]
        here = Visit(browser, service)
        here.fill(raw_folder)
        here.fast()
        job = here.start()
        service.stop(0.0)
        here.page.wait_for_selector("#connection:not([hidden])")
        service.start()
        for each in ahead:
            client.post(f"/v1/jobs/{each}/cancel")
        here.wait_for_state("done")
        here.page.wait_for_selector(".stage canvas")
        assert not here.page.locator("#connection").is_visible()

        # And amid a wish: what was pressed while the service was gone is done once it is back, and once only.
        here.page.get_by_role("link", name="New model").click()
        service.stop(0.0)
        here.page.get_by_role("button", name="Start", exact=True).click()
        here.page.wait_for_selector("#connection:not([hidden])")
        service.start()
        here.page.wait_for_url(lambda url: "/jobs/" in url and job not in url)
        here.wait_for_state("done")
        assert len(client.get("/v1/jobs").json()["items"]) == len(ahead) + 2
        here.close()
        assert all("ERR_" in line for line in here.wrong), here.wrong


def test_only_a_service_that_does_not_answer_is_told_to_be_gone(visit, served, done):
    here = visit()
    page = here.page
    page.evaluate(
        "new MutationObserver(() => { window.told = true; })"
        ".observe(document.getElementById('connection'), { attributes: true })"
    )
    broken = []

    def break_off(route):
        broken.append(route.request.url)
        route.abort() if len(broken) < 3 else route.continue_()

    page.route("**/steps/mesh.jpg", break_off)
    page.goto(f"{served.url}/#/jobs/{done['id']}")
    here.until("document.querySelector('figure img[alt=\"Mesh\"]')?.naturalWidth > 0")
    assert len(broken) == 3 and page.evaluate("window.told") is None, "one request that breaks off is no lost service"

    for path in ("**/healthz", "**/v1/**"):
        page.route(path, lambda route: route.abort())
    page.goto(f"{served.url}/#/jobs")
    page.wait_for_selector("#connection:not([hidden])")
    page.goto(f"{served.url}/#/calibrate")  # which asks the service nothing
    page.unroute_all()
    page.wait_for_selector("#connection", state="hidden")
    assert all("ERR_FAILED" in line for line in here.wrong)
    here.wrong.clear()


def test_a_failed_job_tells_where_and_shows_names_as_they_are(visit, served, owner, raw_folder, done):
    from serving import wait_for

    right, left = (((raw_folder / f"{side}.png").read_bytes()) for side in ("right", "left"))
    files = {"left": ("<img src=x>.png", right), "right": ("right.png", left)}
    fields = {"rig": done["rig"], "options": '{"check": "full"}', "label": "<b>swapped</b>"}
    job = wait_for(owner, owner.post("/v1/jobs", files=files, data=fields).json()["id"])
    here = visit()
    page = here.page
    page.goto(f"{served.url}/#/jobs/{job['id']}")
    page.get_by_role("heading", name="<b>swapped</b>").wait_for()
    assert page.locator(".now").text_content().startswith("Failed at “Check the rig”")
    assert page.locator(".card .alert").text_content() == job["error"]
    assert page.locator(".stages li[data-at=bad]").text_content() == "Check the rig"
    assert page.locator(".stages li[data-at=done]").count() == job["stages"].index("check")
    assert page.get_by_text("<img src=x>.png").count() == 1 and page.locator("h1 b, img[src=x]").count() == 0


def test_a_view_that_is_left_leaves_nothing_behind(visit, served, done):
    here = visit()
    page = here.page
    page.add_init_script(
        """
        window.kept = new Set();
        const { createObjectURL: make, revokeObjectURL: drop } = URL;
        URL.createObjectURL = (blob) => { const url = make.call(URL, blob); kept.add(url); return url; };
        URL.revokeObjectURL = (url) => { kept.delete(url); drop.call(URL, url); };
        const get = HTMLCanvasElement.prototype.getContext;
        HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
          const context = get.call(this, kind, ...rest);
          if (context && kind.includes("webgl")) {
            kept.add(this);
            this.addEventListener("webglcontextlost", () => kept.delete(this));
          }
          return context;
        };
        """
    )
    page.goto(f"{served.url}/#/jobs/{done['id']}")
    page.reload()
    page.wait_for_selector(".stage canvas")
    assert page.evaluate("kept.size") > 5
    page.evaluate(  # and a slow one, which is left while it reads the model
        "() => { const reading = THREE.GLTFLoader.prototype, { parse } = reading; reading.parse = function (...given)"
        " { window.begun = true; setTimeout(() => { parse.apply(this, given); window.read = true; }, 300); }; }"
    )
    page.goto(f"{served.url}/#/jobs")
    page.goto(f"{served.url}/#/jobs/{done['id']}")
    here.until("window.begun")
    page.goto(f"{served.url}/#/calibrate")
    here.until("window.read && kept.size === 0")


def test_the_token_is_asked_for_until_it_is_right(visit, served, done):
    here = visit(token="")
    page = here.page
    dialog = page.get_by_role("dialog")
    dialog.wait_for()
    page.keyboard.press("Escape")
    assert dialog.is_visible(), "without a token nothing can be done"
    page.get_by_label("Token", exact=True).and_(page.get_by_role("textbox")).fill("wrong")
    page.keyboard.press("Enter")
    page.get_by_text("This token is not known").wait_for()
    page.get_by_label("Token", exact=True).and_(page.get_by_role("textbox")).fill(served.token)
    page.keyboard.press("Enter")
    page.get_by_role("link", name="Jobs").click()
    page.get_by_role("link", name="cup").first.wait_for()
    page.reload()  # it is kept for this tab
    page.get_by_role("link", name="cup").first.wait_for()
    # A token that is valid no more is asked for once, also where another answer to it comes late.
    held = []
    page.goto(f"{served.url}/#/calibrate")
    page.route("**/v1/rigs", lambda route: held.append(route), times=1)
    page.evaluate(
        "() => { sessionStorage.setItem('stereo-gpu-token', 'old'); import('/page/api.js').then(async ({ getJson }) =>"
        " { window.rigs = await getJson('/v1/rigs'); }); }"
    )
    while not held:
        page.wait_for_timeout(20)
    page.goto(f"{served.url}/#/jobs")
    page.get_by_label("Token", exact=True).and_(page.get_by_role("textbox")).fill(served.token)
    page.keyboard.press("Enter")
    page.get_by_role("link", name="cup").first.wait_for()
    held[0].continue_()
    here.until("window.rigs")
    assert not dialog.is_visible()
    assert all("401" in line for line in here.wrong) and here.wrong
    here.wrong.clear()
    other = visit(token=served.token_of("stranger"))
    other.page.goto(f"{served.url}/#/jobs/{done['id']}")
    other.page.get_by_text("There is no such job").wait_for()
    assert all("404" in line for line in other.wrong) and other.wrong
    other.wrong.clear()


def test_the_gallery_goes_by_pages_and_by_state(visit, served, raw_folder):
    from serving import FAST, add_rig, post_pair

    with served.client(served.token_of("busy")) as busy:
        rig = add_rig(busy, raw_folder)
        for number in range(5):
            job = post_pair(busy, raw_folder, rig, FAST, label=f"job {number}").json()
            busy.post(f"/v1/jobs/{job['id']}/cancel")
        here = visit(token=served.token_of("busy"))
        page = here.page
        page.goto(f"{served.url}/#/jobs?limit=3")
        page.get_by_role("link", name="job 4").wait_for()
        assert page.locator(".grid li").count() == 3
        page.get_by_role("link", name="Older").click()
        page.get_by_role("link", name="job 1", exact=True).wait_for()
        assert page.locator(".grid li").count() == 2 and page.get_by_role("link", name="Older").count() == 0
        page.go_back()
        page.get_by_role("link", name="job 4").wait_for()
        page.get_by_label("State").select_option("failed")
        page.get_by_text("No jobs here.").wait_for()
        page.get_by_label("State").select_option("cancelled")
        page.get_by_role("link", name="job 4").wait_for()


def test_board_pictures_become_a_rig_to_use(visit, served, data):
    folder = data / "calibration" / "board_10x7"
    here = visit(token=served.token_of("calibrator"))
    page = here.page
    page.get_by_role("link", name="Calibrate").click()
    lefts, rights = (sorted(folder.glob(f"{side}*.jpg"))[:4] for side in ("left", "right"))
    page.get_by_label("Pictures of the left camera").set_input_files(lefts)
    page.get_by_label("Pictures of the right camera").set_input_files(rights[:3])
    page.get_by_role("button", name="Calibrate").click()
    assert "4 pictures of the left camera and 3 of the right one" in page.locator("form > [role=alert]").text_content()
    page.get_by_label("Pictures of the right camera").set_input_files(rights)
    page.get_by_label("Name of the rig").fill("bench")
    page.get_by_role("button", name="Calibrate").click()
    here.wait_for_state("done")
    page.get_by_role("link", name="Use this rig").wait_for()
    here.until("[...document.querySelectorAll('.drawn img')].every((image) => image.naturalWidth)")
    assert page.locator(".drawn img").count() >= 3 and page.locator(".views tbody tr").count() == 4
    assert re.search(r"0\.\d{3} px", page.locator(".tiles").text_content())
    assert page.get_by_text("left01.jpg", exact=True).count() == 1
    page.get_by_role("link", name="Use this rig").click()
    here.until("document.querySelector('select')?.value")
    assert (
        page.get_by_label("Rig", exact=True).locator("option:checked").text_content().startswith("bench · 640 × 480 px")
    )


def test_without_webgl_there_is_a_picture(visit, served, done):
    here = visit()
    here.page.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext; HTMLCanvasElement.prototype.getContext ="
        " function (kind, ...rest) { return kind.includes('webgl') ? null : get.call(this, kind, ...rest); };"
    )
    here.page.goto(f"{served.url}/#/jobs/{done['id']}")
    here.page.reload()
    here.page.get_by_text("cannot be turned here").wait_for()
    here.until("document.querySelector('.stage img')?.naturalWidth > 0")
    assert all("WebGL" in line for line in here.wrong)  # three.js says so itself
    here.wrong.clear()
