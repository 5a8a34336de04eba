"""The page in a browser: headless Chromium, driven by selenium.

One browser for the file; every test opens a page anew and must leave no error on the console.
"""

import functools
import io
import re
import shutil
import time

import numpy as np
import pytest

import jaxmotion as jm
from jaxmotion.cli._page import document, table_of
from jaxmotion.contacts import ContactPoints, Contacts
from jaxmotion.viz import player
from tests.helpers import random_motion
from tests.viz.test_body import standing_root
from tests.viz.test_player import HOSTILE, content, named, oracle, upright, walk

webdriver = pytest.importorskip("selenium.webdriver", reason="no selenium: pip install selenium")
image = pytest.importorskip("PIL.Image", reason="no Pillow: pip install matplotlib")
CHROMIUM = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), ""
)
DRIVER = shutil.which("chromedriver")
pytestmark = [
    pytest.mark.skipif(not CHROMIUM, reason="no browser: apt-get install chromium"),
    pytest.mark.skipif(not DRIVER, reason="no chromedriver: apt-get install chromium-driver"),
]
FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--disable-quic"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
    *("--disable-sync", "--hide-scrollbars", "--disable-extensions"),
)
RENDERERS = ("webgl2", "canvas2d")
CAMERAS = (  # eye and target in the page's world
    ((0.9, 0.6, 1.6), (0.2, 0.2, 0.1)),
    ((-1.2, 1.3, -0.6), (0.1, 0.3, 0.0)),
    ((0.4, 0.2, -1.9), (0.2, 0.1, 0.2)),
)


class Browser:
    """Chromium with one page open."""

    def __init__(self, folder):
        options = webdriver.ChromeOptions()
        options.binary_location = CHROMIUM
        for flag in (*FLAGS, f"--user-data-dir={folder / 'user'}"):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        service = webdriver.chrome.service.Service(DRIVER)
        self.driver = webdriver.Chrome(options=options, service=service)
        self.folder = folder
        self.files = {}

    def open(self, page, asked="paused", size=(900, 700)):
        """``page``: a name of ``PAGES``; ``asked``: what stands behind #."""
        if page not in self.files:
            self.files[page] = self.folder / f"{page}.html"
            PAGES[page]().save(self.files[page])
        self.resize(*size)
        self.driver.get("about:blank")
        self.driver.get(f"{self.files[page].as_uri()}#{asked}")
        self.settle()

    def resize(self, width, height):
        metrics = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)

    def js(self, script, *args):
        return self.driver.execute_script(f"const p = window.jaxmotionPlayer; {script}", *args)

    def get(self, expression, *args):
        return self.js(f"return {expression}", *args)

    def settle(self):
        """Until what was asked for is drawn."""
        twice = "requestAnimationFrame(() => requestAnimationFrame(arguments[0]))"
        self.driver.execute_async_script(twice)

    def key(self, key, **held):
        names = {" ": "Space", "?": "Slash"}
        shift = 8 * (held.get("shift", False) or key == "?")
        event = {"key": key, "code": names.get(key, key), "modifiers": shift}
        if len(key) == 1:
            event["text"] = key
        for kind in ("keyDown", "keyUp"):
            event = {**event, "type": kind}
            self.driver.execute_cdp_cmd("Input.dispatchKeyEvent", event)
        self.settle()

    def mouse(self, kind, x, y, button="left", shift=False, **more):
        event = {"type": kind, "x": x, "y": y, "button": button, "modifiers": 8 * shift, **more}
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", event)

    def drag(self, a, b, button="left", shift=False):
        held = {"buttons": {"left": 1, "right": 2}[button]}
        self.mouse("mousePressed", *a, button, shift, clickCount=1, **held)
        for t in (0.5, 1.0):
            at = [p + t * (q - p) for p, q in zip(a, b, strict=True)]
            self.mouse("mouseMoved", *at, button, shift, **held)
        self.mouse("mouseReleased", *b, button, shift, clickCount=1)
        self.settle()

    def touch(self, *steps):
        """Places of the fingers, one after the other."""
        for k, places in enumerate(steps):
            points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(places)]
            kind = "touchMove" if k else "touchStart"
            event = {"type": kind, "touchPoints": points}
            self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", event)
        self.driver.execute_cdp_cmd(
            "Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []}
        )
        self.settle()

    def box(self, selector):
        """x, y, width, height."""
        return self.get(
            "(({x, y, width, height}) => [x, y, width, height])"
            "(document.querySelector(arguments[0]).getBoundingClientRect())",
            selector,
        )

    def text(self, selector):
        return self.get("document.querySelector(arguments[0]).textContent", selector)

    def pixels(self):
        """What is on the screen, u8[y, x, 3]."""
        with image.open(io.BytesIO(self.driver.get_screenshot_as_png())) as shot:
            return np.asarray(shot.convert("RGB")).astype(int)

    def errors(self):
        return [e for e in self.driver.get_log("browser") if e["level"] == "SEVERE"]


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("browser"))
    yield started
    started.driver.quit()


@pytest.fixture
def browser(chromium):
    chromium.errors()
    yield chromium
    assert not chromium.errors()


# Pages


def chain(frames=12):
    """Three joints without an end site: the last is a ball of its own."""
    offsets = [[0.0, 1.0, 0.0], [0.3, 0.2, 0.1], [0.25, -0.1, 0.3]]
    skeleton = jm.Skeleton(["root", "elbow", "hand"], [-1, 0, 1], np.array(offsets))
    q = np.array(random_motion(np.random.default_rng(3), frames, 3).rotations)
    root = np.array([[0.1, 1.0, 0.2]]) + 0.02 * np.arange(frames)[:, None]
    return jm.Motion.from_root(skeleton, root, q, 1 / 30)


@functools.cache
def clip():
    return walk(60)


def marked():
    motion = clip()
    points = ContactPoints(motion.skeleton, ["LeftFoot", "RightFoot"])
    on = np.zeros((60, 2), bool)
    on[5:20, 0] = on[30:50, 1] = True
    mask = np.zeros((60, 22), bool)
    mask[15:22, motion.skeleton.index("LeftArm")] = mask[40:44, 3] = True
    return player(
        motion,
        contacts=Contacts(points, on, points.positions(motion)),
        errors=mask,
        curves={"energy": np.arange(60.0) ** 2},
        title="marked",
    )


def two():
    slow = jm.resample(clip(), fps=24.0)[:18]
    return player({"before": clip(), "after": jm.reorient(slow, "z")}, title="two")


def apart():
    motion = clip()
    there = np.array(motion.translations)
    there[:, 0] += [5.0, 0.0, -3.0]
    return motion, motion.replace(translations=there)


def missing():
    motion = clip()
    t = np.array(motion.translations)
    t[20:30] = np.nan
    return player(motion.replace(translations=t))


class Table:
    """A page of the command line's, with one table."""

    def __init__(self, rows):
        self.rows = rows

    def save(self, path):
        path.write_text(document("report", [table_of("rows", self.rows)]))


PAGES = {
    "chain": lambda: player(chain()),
    "walk": lambda: player(clip(), title="walk.bvh"),
    "marked": marked,
    "two": two,
    "missing": missing,
    "apart": lambda: player(dict(zip("ab", apart(), strict=True)), side_by_side=True),
    "hostile": lambda: player(
        {HOSTILE[1]: named(random_motion(np.random.default_rng(0), 5, 6), HOSTILE)},
        title=HOSTILE[0],
    ),
    "same": lambda: player({"before": clip(), "after": clip()}),
    "six": lambda: player(
        {f"c{k}": clip() for k in range(6)},
        contacts={f"c{k}": jm.contacts.detect(clip()) for k in range(6)},
        errors={f"c{k}": np.arange(60) // 3 == 3 * k + 1 for k in range(6)},
    ),
    "wide": lambda: Table(
        [
            {"file": f"takes/day one/walk {k}.bvh"} | {f"n{c}": 1.5 * c for c in range(20)}
            for k in "ab"
        ]
    ),
    "table": lambda: Table(
        [
            {"file": "take10", "degrees": 0.5},
            {"file": "take9", "degrees": 12.0},
            {"file": "b", "degrees": None},
            {"file": "C", "degrees": float("-inf")},
            {"file": "d", "degrees": -3.0},
        ]
    ),
    "rooted": lambda: player(standing_root(30)[1]),
    "differing": lambda: player(
        {"before": clip(), "after": clip()},
        curves={"turned, °": np.arange(60.0)},
    ),
    "z up": lambda: player(jm.reorient(clip(), "z")),
    "large": lambda: player(random_motion(np.random.default_rng(0), 2526, 65)),
    "one frame": lambda: player(clip()[3]),
}


def projection(points, eye, target, fov, view):
    """Pixels of world points: a camera written anew, by rows, z ahead."""
    eye, target = np.asarray(eye, float), np.asarray(target, float)
    ahead = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(ahead, [0, 1, 0])
    right /= np.linalg.norm(right)
    seen = (np.asarray(points) - eye) @ np.stack([right, np.cross(right, ahead), ahead]).T
    scale = view["h"] / 2 / np.tan(fov / 2)
    x = view["x"] + view["w"] / 2 + scale * seen[..., 0] / seen[..., 2]
    y = view["y"] + view["h"] / 2 - scale * seen[..., 1] / seen[..., 2]
    return np.stack([x, y], -1)


def world(motion, page):
    """Points f[T, P, 3] in the page's world."""
    return upright(oracle(motion), motion.skeleton.up) - content(page)["origin"]


def look_from(browser, eye, target):
    browser.js(
        "p.follow = false; p.camera = {eye: arguments[0], target: arguments[1]}", eye, target
    )
    browser.settle()


# Opened


@pytest.mark.parametrize("renderer", RENDERERS)
def test_opens_from_disk_and_shows_the_figure(browser, renderer):
    browser.driver.get_log("performance")
    browser.open("walk", f"paused&{renderer}")
    assert browser.get("p.renderer") == renderer
    log = [entry["message"] for entry in browser.driver.get_log("performance")]
    sent = [line for line in log if '"Network.requestWillBeSent"' in line]
    assert sent
    asked = [re.search(r'"request":.*?"url":"(.*?)"', line)[1] for line in sent]
    own = [url for url in asked if not url.startswith("chrome")]  # its first tab
    assert {url.partition(":")[0] for url in own} <= {"file", "data", "about"}, own
    assert browser.get("performance.getEntriesByType('resource').length") == 0
    red, _, blue = np.moveaxis(browser.pixels(), -1, 0)
    left, top, width, height = map(int, browser.box("#stage"))
    figure = (blue - red > 40)[top : top + height, left : left + width]
    assert 0.003 < figure.mean() < 0.3
    rows = np.flatnonzero(figure.any(axis=1))
    assert np.ptp(rows) > 0.4 * height
    assert browser.text("#title") == "walk.bvh"
    assert browser.text("#about") == "60 frames · 1.00 s · 60 fps · 22 joints"


@pytest.mark.parametrize("renderer", RENDERERS)
def test_joints_are_where_a_camera_sees_them(browser, renderer):
    browser.open("chain", f"paused&{renderer}")
    points = world(chain(), player(chain()))
    browser.js("p.picked = ['hand']; p.hidden = ['root', 'elbow']")
    for frame, (eye, target) in zip((0, 5, 11), CAMERAS, strict=True):
        browser.js("p.frame = arguments[0]", frame)
        look_from(browser, eye, target)
        camera, view = browser.get("p.camera"), browser.get("p.viewport()")
        assert [view["w"], view["h"]] == browser.box("#stage")[2:]
        want = projection(points[frame], eye, target, camera["fov"], view)
        got = [browser.get("p.project(arguments[0])", joint) for joint in chain().skeleton.names]
        np.testing.assert_allclose(got, want, atol=0.1)
        red, _, blue = np.moveaxis(browser.pixels(), -1, 0)
        ball = np.argwhere((red - blue > 60)[: int(view["h"])])
        assert len(ball) > 10
        np.testing.assert_allclose(ball.mean(axis=0)[::-1] + 0.5, want[2], atol=1.0)


@pytest.mark.parametrize("page", ["walk", "z up"])
def test_every_joint_of_a_figure_that_stands(browser, page):
    browser.open(page, "paused&frame=33")
    made = clip() if page == "walk" else jm.reorient(clip(), "z")
    points = world(made, PAGES[page]())
    camera, view = browser.get("p.camera"), browser.get("p.viewport()")
    want = projection(points[33, :22], camera["eye"], camera["target"], camera["fov"], view)
    got = browser.get("p.joints.map((name) => p.project(name))")
    np.testing.assert_allclose(got, want, atol=0.5)
    head, foot = (made.skeleton.index(name) for name in ("Head", "LeftFoot"))
    assert want[head, 1] < want[foot, 1] - 0.35 * view["h"]


def test_where_webgl_is_lost_a_plain_canvas_goes_on(browser):
    browser.open("walk", "paused")
    assert browser.get("p.renderer") == "webgl2"
    lose = "getContext('webgl2').getExtension('WEBGL_lose_context').loseContext()"
    browser.js(f"document.getElementById('scene').{lose}")
    browser.settle()
    assert browser.get("p.renderer") == "canvas2d"
    yaw = browser.get("p.camera.yaw")
    browser.drag((400, 250), (500, 250))
    assert browser.get("p.camera.yaw") != yaw


def test_slow_webgl_gives_way(browser):
    """As without a graphics card: here every frame takes 60 ms."""
    slow = "window.requestAnimationFrame = (f) => setTimeout(() => f(performance.now()), 60)"
    made = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": slow})
    try:
        for asked, renderer in (("speed=1", "canvas2d"), ("webgl2", "webgl2")):
            browser.open("chain", asked)
            stop = time.monotonic() + 20
            while browser.get("p.timing.frames") < 40 and time.monotonic() < stop:
                time.sleep(0.05)
            assert browser.get("p.renderer") == renderer
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", made)


# Time


def test_plays_and_stops(browser):
    browser.open("walk", "canvas2d")
    assert browser.get("p.playing") is True
    before = browser.get("p.time")
    time.sleep(0.2)
    browser.key(" ")
    assert browser.get("p.playing") is False
    stopped = browser.get("p.time")
    assert stopped != before
    time.sleep(0.1)
    assert browser.get("p.time") == stopped
    browser.js("p.frame = 59; p.play()")
    browser.settle()
    assert browser.get("p.frame") < 50


def test_scrubbing(browser):
    browser.open("walk", "canvas2d")
    x, y, width, _ = browser.box("#timeline")
    left, right = 116, 14  # beside the strips
    at = lambda frame: x + left + (frame + 0.5) / 60 * (width - left - right)  # noqa: E731
    browser.drag((at(10), y + 8), (at(40), y + 8))
    assert browser.get("p.playing") is True  # it goes on from there
    browser.js("p.pause()")
    browser.drag((at(10), y + 8), (at(40), y + 8))
    assert browser.get("p.frame") == 40
    assert browser.text("#clock b") == "40 / 59"
    _, top, _, high = browser.box("#curves")
    browser.drag((at(25), top + high / 2), (at(25), top + high / 2))
    assert browser.get("p.frame") == 25
    browser.drag((at(12), y + 8), (at(30), y + 8), shift=True)
    assert browser.get("p.loop") == [12, 30]
    browser.drag((at(30.5), y + 8), (at(50), y + 8))
    assert browser.get("p.loop") == [12, 50]


def test_a_loop_is_kept(browser):
    browser.open("walk", "canvas2d&loop=20-26&frame=20&speed=2")
    frames = browser.driver.execute_async_script("""
        const done = arguments[0], seen = [];
        const look = () => {
          seen.push(jaxmotionPlayer.frame);
          if (seen.length < 40) requestAnimationFrame(look); else done(seen);
        };
        look();""")
    assert set(frames) <= set(range(20, 27))
    assert len(set(frames)) > 3


def test_keys(browser):
    browser.open("marked", "paused&canvas2d")
    steps = [("ArrowRight", 1), ("End", 59), ("ArrowLeft", 58), ("Home", 0), ("n", 15), ("n", 40)]
    for key, frame in [*steps, ("p", 15)]:
        browser.key(key)
        assert browser.get("p.frame") == frame, key
    browser.key("ArrowRight", shift=True)
    assert browser.get("p.frame") == 25
    browser.key("[")
    browser.key("ArrowRight")
    browser.key("]")
    assert browser.get("p.loop") == [25, 26]
    browser.key("\\")
    assert browser.get("p.loop") is None
    for key, name in [
        ("f", "follow"),
        ("t", "trail"),
        ("c", "contacts"),
        ("x", "marks"),
        ("j", "list"),
    ]:
        was = browser.get(f"p.{name}")
        browser.key(key)
        assert browser.get(f"p.{name}") is not was, name
    browser.key(".")
    assert browser.get("p.speed") == 2
    browser.key("d")
    assert browser.get("p.theme") == "dark"
    browser.js("document.querySelector('[data-name=first]').focus()")
    frame = browser.get("p.frame")
    browser.key(" ")
    browser.key(" ")
    assert browser.get("p.playing") is False
    assert browser.get("p.frame") >= frame  # the button was not pressed
    yaws = []
    for key in "123":
        browser.key(key)
        yaws.append(browser.get("[p.camera.yaw, p.camera.pitch]"))
    assert abs(yaws[1][0] - yaws[0][0] - np.pi / 2) < 1e-6
    assert yaws[2][1] > 1.4
    browser.key("?")
    assert browser.get("document.getElementById('help').hidden") is False
    browser.key("Escape")
    assert browser.get("document.getElementById('help').hidden") is True


@pytest.mark.parametrize("seek", ["frame=42", "time=0.7"])
def test_the_address_seeks(browser, seek):
    browser.open("walk", f"{seek}&paused&camera=30,10,4&follow=0&pick=Head&theme=dark&canvas2d")
    assert browser.get("[p.frame, p.playing, p.theme]") == [42, False, "dark"]
    camera = browser.get("p.camera")
    np.testing.assert_allclose(np.degrees([camera["yaw"], camera["pitch"]]), [30, 10])
    assert camera["distance"] == 4
    assert browser.get("p.picked") == ["Head"]
    browser.js("location.hash = 'frame=7'")
    browser.settle()
    assert browser.get("p.frame") == 7


# Pointers


def test_the_mouse_turns_moves_and_zooms(browser):
    browser.open("walk", "paused&canvas2d")
    before = browser.get("p.camera")
    browser.drag((400, 250), (460, 230))
    turned = browser.get("p.camera")
    assert turned["yaw"] != before["yaw"]
    assert turned["pitch"] != before["pitch"]
    assert turned["target"] == before["target"]
    hips = browser.get("p.project('Hips')")
    browser.drag((400, 250), (450, 280), button="right")
    moved = browser.get("p.project('Hips')")
    np.testing.assert_allclose(np.subtract(moved, hips), [50, 30], rtol=0.2)  # near the target
    browser.mouse("mouseWheel", 400, 250, deltaX=0, deltaY=-200)
    browser.settle()
    assert browser.get("p.camera.distance") < turned["distance"]


def test_fingers_turn_and_pinch(browser):
    browser.open("walk", "paused&canvas2d", size=(400, 800))
    before = browser.get("p.camera")
    browser.touch([(200, 200)], [(240, 210)])
    turned = browser.get("p.camera")
    assert turned["yaw"] != before["yaw"]
    assert turned["distance"] == before["distance"]
    browser.touch([(180, 200), (220, 200)], [(140, 200), (260, 200)])
    pinched = browser.get("p.camera")
    assert abs(pinched["distance"] / turned["distance"] - 1 / 3) < 0.05
    assert pinched["yaw"] == turned["yaw"]


def test_joints_have_names_and_can_be_picked(browser):
    browser.open("marked", "paused&canvas2d&curve=rotation angle")
    assert "mean of joints" in browser.text("#values")
    at = browser.get("p.project('LeftForeArm')")
    browser.mouse("mouseMoved", *at, button="none")
    browser.settle()
    assert browser.text("#tip") == "LeftForeArm"
    browser.drag(at, at)
    assert browser.get("p.picked") == ["LeftForeArm"]
    assert "LeftForeArm" in browser.text("#values")
    q = np.asarray(clip().rotations, float)[0, clip().skeleton.index("LeftForeArm")]
    angle = np.degrees(2 * np.arctan2(np.linalg.norm(q[1:]), abs(q[0])))
    assert abs(float(browser.text("#values b").rstrip("°")) - angle) < 0.1
    browser.drag((15, 300), (15, 300))
    assert browser.get("p.picked") == []
    browser.js("const w = document.getElementById('which'); w.value = 2; w.onchange(); p.frame = 9")
    browser.settle()
    assert browser.text("#values b") == "81.0"


def test_the_list_of_joints_hides_and_picks(browser):
    browser.open("walk", "paused&canvas2d&list")
    names = browser.get("[...document.querySelectorAll('#list .joint')].map((x) => x.textContent)")
    assert names == list(clip().skeleton.names)
    figure = lambda: (lambda p: (p[..., 2] - p[..., 0] > 40).sum())(browser.pixels()[:400, :600])  # noqa: E731
    before = figure()
    browser.js(
        "document.querySelectorAll('#list .eye')[arguments[0]].click()", names.index("LeftUpLeg")
    )
    browser.settle()
    assert browser.get("p.hidden") == ["LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"]
    assert figure() < 0.95 * before
    browser.js("document.querySelectorAll('#list .joint')[3].click()")
    assert browser.get("p.picked") == [names[3]]
    browser.js(
        "const s = document.getElementById('search'); s.value = 'hand'; s.oninput({target: s})"
    )
    shown = browser.get(
        "[...document.querySelectorAll('#list li:not([hidden])')].map((x) => x.textContent)"
    )
    assert shown == ["LeftHand", "RightHand"]


# Sizes, several clips, odd ones


def test_resized(browser):
    browser.open("walk", "paused&canvas2d")
    browser.resize(400, 800)
    browser.settle()
    time.sleep(0.1)
    browser.settle()
    assert browser.get("document.documentElement.scrollWidth") <= 400
    view, camera = browser.get("p.viewport()"), browser.get("p.camera")
    assert view["w"] == 400
    points = world(clip(), PAGES["walk"]())[0, :22]
    want = projection(points, camera["eye"], camera["target"], camera["fov"], view)
    np.testing.assert_allclose(browser.get("p.joints.map((j) => p.project(j))"), want, atol=0.5)
    assert (want[:, 0] > 0).all()
    assert (want[:, 0] < 400).all()


def test_clips_share_a_clock_and_stand_side_by_side(browser):
    browser.open("two", "paused&canvas2d&follow=0")
    slow = jm.resample(clip(), fps=24.0)[:18]
    points = [world(clip(), PAGES["two"]()), None]
    points[1] = upright(oracle(slow), "y") - content(PAGES["two"]())["origin"]
    assert browser.get("p.numFrames") == 60
    for frame, other in ((0, 0), (29, 12), (31, 12), (40, 16), (59, 17)):
        browser.js("p.frame = arguments[0]", frame)
        for k, at in enumerate((frame, other)):
            got = browser.get("p.joints.map((j) => p.position(j, arguments[0]))", k)
            np.testing.assert_allclose(got, points[k][at, :22], atol=1e-3)
    one = browser.get("[p.viewport(0), p.viewport(1)]")
    assert one[0] == one[1]
    browser.key("s")
    left, right = browser.get("[p.viewport(0), p.viewport(1)]")
    assert [left["w"], right["x"], right["w"]] == [450, 450, 450]
    assert browser.text("#labels") == "beforeafter"
    camera = browser.get("p.camera")
    for k, view in enumerate((left, right)):
        want = projection(
            points[k][(59, 17)[k], :22], camera["eye"], camera["target"], camera["fov"], view
        )
        got = browser.get("p.joints.map((j) => p.project(j, arguments[0]))", k)
        np.testing.assert_allclose(got, want, atol=0.5)
    browser.js("document.querySelectorAll('#legend button')[1].click()")
    browser.settle()
    assert browser.get("p.viewport(0).w") == 900


def test_takes_that_start_elsewhere_have_views_of_their_own(browser):
    browser.open("apart", "paused&canvas2d&frame=30")
    left, right = browser.get("[p.viewport(0), p.viewport(1)]")
    hips = browser.get("[p.project('Hips', 0), p.project('Hips', 1)]")
    for view, (x, _) in zip((left, right), hips, strict=True):
        assert abs(x - view["x"] - view["w"] / 2) < 0.2 * view["w"]
    camera = browser.get("p.camera")
    page = PAGES["apart"]()
    one, two = (world(m, page) for m in apart())
    away = (two - one)[30, 0] * [1, 0, 1]
    eye, target = np.add(camera["eye"], away), np.add(camera["target"], away)
    want = projection(two[30, :22], eye, target, camera["fov"], right)
    got = browser.get("p.joints.map((j) => p.project(j, 1))")
    np.testing.assert_allclose(got, want, atol=0.5)
    browser.key("s")
    assert browser.get("p.viewport(0)") == browser.get("p.viewport(1)")


def test_the_look_is_the_systems(browser):
    for scheme in ("dark", "light"):
        media = {"features": [{"name": "prefers-color-scheme", "value": scheme}]}
        browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
        browser.open("walk", "paused&canvas2d")
        assert browser.get("p.theme") == scheme
        assert (browser.pixels()[5:50, 300:400].mean() > 128) == (scheme == "light")
    media = {"features": [{"name": "prefers-reduced-motion", "value": "reduce"}]}
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", media)
    browser.open("walk", "canvas2d")
    assert browser.get("p.playing") is False
    browser.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": []})


def test_missing_frames_are_told(browser):
    browser.open("missing", "paused&canvas2d&frame=25")
    assert browser.text("#notice") == "nothing is known at this frame"
    assert browser.get("document.getElementById('notice').hidden") is False
    browser.js("p.frame = 31")
    browser.settle()
    assert browser.get("document.getElementById('notice').hidden") is True


@pytest.mark.parametrize("page", ["one frame", "marked", "two"])
@pytest.mark.parametrize("renderer", RENDERERS)
def test_everything_at_once(browser, page, renderer):
    browser.open(page, f"frame=18&{renderer}&trail&list&side&theme=dark&pick=LeftArm&pick=Head")
    browser.js("p.step(1)")
    browser.settle()
    assert browser.get("p.timing.frames") > 0


def test_names_do_not_escape(browser):
    browser.open("hostile", "list&canvas2d")
    assert browser.get("window.caught === undefined") is True
    assert browser.get("document.querySelectorAll('script').length") == 2
    assert browser.get("document.querySelectorAll('img').length") == 0
    names = browser.get("[...document.querySelectorAll('#list .joint')].map((x) => x.textContent)")
    assert names[0] == HOSTILE[0]
    assert names[1] == HOSTILE[1]
    assert browser.text("#title") == HOSTILE[0]
    browser.js("p.picked = p.joints")
    browser.settle()
    assert browser.get("window.caught === undefined") is True


def test_a_notebook_shows_it_in_a_frame(browser, tmp_path):
    path = tmp_path / "notebook.html"
    path.write_text(f"<!doctype html><meta charset=utf-8>{clip()._repr_html_()}", encoding="utf-8")
    browser.resize(900, 700)
    browser.driver.get(path.as_uri())
    browser.driver.switch_to.frame(0)
    assert browser.get("[p.numFrames, p.playing]") == [60, False]
    assert browser.get("document.getElementById('curves').getBoundingClientRect().height") == 0
    browser.driver.switch_to.default_content()


# Speed


@pytest.mark.parametrize("renderer", RENDERERS)
def test_the_time_of_a_frame(browser, renderer):
    browser.open("large", f"paused&{renderer}")
    whole, own = browser.get("[p.measure(20), p.timing.draw]")
    print(
        f"\n{renderer}, 2526 × 65: {whole:.1f} ms a frame in software, {own:.1f} ms of it scripts"
    )
    assert own < 100


@pytest.mark.parametrize("renderer", RENDERERS)
def test_a_large_clip_opens_and_plays(browser, renderer):
    browser.open("large", renderer)  # written
    browser.driver.get("about:blank")
    browser.driver.get(f"{browser.files['large'].as_uri()}#{renderer}")
    seconds = browser.driver.execute_async_script("""
        const done = arguments[0];
        const look = () => {
          if (jaxmotionPlayer.frame > 0) done(performance.now() / 1000);
          else requestAnimationFrame(look);
        };
        look();""")
    print(f"\n{renderer}, 2526 × 65: open and playing after {seconds:.2f} s")
    assert seconds < 5


@pytest.mark.parametrize("renderer", RENDERERS)
def test_where_clips_are_the_same_the_last_is_seen(browser, renderer):
    """Whole, not in patches of both colours."""
    browser.open("same", f"paused&{renderer}")
    pixels = browser.pixels()[: int(browser.box("#stage")[3])]
    red, _, blue = np.moveaxis(pixels, -1, 0)
    x, y, w, h = (int(v) for v in browser.box("#stage"))
    inside = np.zeros(red.shape, bool)
    inside[y + 90 : y + h, x : x + w] = True  # below the names, which have both colours
    assert (inside & (blue - red > 60)).sum() > 200
    assert (inside & (red - blue > 60)).sum() < 20


def test_a_root_that_stays_does_not_make_the_figure_small(browser):
    """No more than half of the stage's height is left, and no line leads to the root."""
    browser.open("rooted")
    _, _, _, high = browser.box("#stage")
    head, foot = (browser.get("p.project(arguments[0])", name) for name in ("Head", "LeftToeBase"))
    assert abs(head[1] - foot[1]) > 0.4 * high


def test_curves_of_a_pair_are_of_no_clip(browser):
    browser.open("differing")
    said = browser.get("document.body.innerText")
    assert "turned, °" in said
    assert "before, turned" not in said


def test_a_change_of_address_changes_the_curve(browser):
    browser.open("walk", "paused&pick=LeftFoot&curve=joint speed")
    assert "LeftFoot" in browser.text("#reading")
    browser.js("location.hash = 'paused&pick=Head&curve=rotation angle'")
    browser.settle()
    browser.settle()
    said = browser.text("#reading")
    assert "Head" in said
    assert "LeftFoot" not in said
    assert "°" in said


def test_errors_whose_rows_do_not_fit_are_found(browser):
    """Six clips of five rows are more than are shown."""
    browser.open("six")
    found = []
    for _ in range(8):
        browser.key("n")
        found.append(browser.get("p.frame"))
    assert found[:6] == [3, 12, 21, 30, 39, 48]


def test_speeds_and_loops_by_key(browser):
    browser.open("walk", "paused&speed=3")
    browser.key(".")
    assert browser.get("p.speed") == 4
    browser.js("p.speed = 0.3")
    browser.key(",")
    assert browser.get("p.speed") == 0.25
    browser.js("p.frame = 10")
    browser.key("]")
    assert browser.get("p.loop") == [0, 10]
    browser.js("p.frame = 30")
    browser.key("[")
    assert browser.get("p.loop") == [30, 59]


def test_a_page_that_is_not_seen_at_first(browser):
    """In a frame without room it starts all the same, and is drawn when there is some."""
    browser.open("marked", "", size=(20, 20))
    assert browser.get("p.numFrames") > 1
    assert not browser.errors()
    browser.resize(900, 700)
    browser.settle()
    assert browser.get("p.playing")
    assert len(np.unique(browser.pixels())) > 50


def test_tables_of_reports_are_sorted_by_a_click(browser):
    """Downwards, then upwards; numbers as numbers, also in names; what is not known last."""
    browser.open("table")
    seen = "[...document.querySelectorAll('tbody tr')].map(row => row.cells[0].textContent)"

    def click(column):
        browser.js(f"document.querySelectorAll('thead th')[{column}].click()")
        return browser.get(seen)

    assert browser.get(seen) == ["take10", "take9", "b", "C", "d"]
    assert click(1) == ["take9", "take10", "d", "C", "b"]
    assert click(1) == ["C", "d", "take10", "take9", "b"]
    assert click(0) == ["take10", "take9", "d", "C", "b"]
    assert click(0) == ["b", "C", "d", "take9", "take10"]
    sorts = "[...document.querySelectorAll('thead th')].map(th => th.getAttribute('aria-sort'))"
    assert browser.get(sorts) == ["ascending", None]


@pytest.mark.parametrize("width", [400, 900])
def test_a_wide_table_scrolls_in_its_box(browser, width):
    """The page is as wide as the window; the first column stays where it is, over the others."""
    browser.open("wide", "", (width, 700))
    place = "(() => { const r = document.querySelector('%s').getBoundingClientRect();"
    place += " return [r.left, r.right]; })()"
    box, first, second = ".table", "tbody td", "tbody td:nth-child(2)"
    before = {name: browser.get(place % name) for name in (box, first, second)}
    assert before[box][1] <= width
    assert before[first][1] < 0.6 * width
    browser.js("document.querySelector('.table').scrollLeft = 300")
    browser.settle()
    assert browser.get("document.documentElement.scrollWidth") == width
    assert browser.get(place % first) == before[first]
    assert browser.get(place % second)[0] == pytest.approx(before[second][0] - 300, abs=1)
    at = "document.elementFromPoint({}, document.querySelector('tbody td').{}.top + 5).cellIndex"
    assert browser.get(at.format(before[first][1] - 3, "getBoundingClientRect()")) == 0
    colour = browser.get("getComputedStyle(document.querySelector('tbody td')).backgroundColor")
    assert re.fullmatch(r"rgb\(.*\)", colour), "what is beneath shows through"
