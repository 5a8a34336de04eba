"""The pictures of the README and of docs/, of built-in clips but for one.

    python docs/pictures.py [NAME ...]        remakes docs/pictures/NAME.png, by default all

Needs ``pip install '.[test]'``: matplotlib, SciPy for a filter to compare with, selenium and
Chromium for the player. Some three minutes. Most are drawn by ``jaxmotion.viz``; two experiments
have scripts of their own in notebooks/; the last, of real captures, is of benchmarks/papers/.
"""

import importlib.util
import shutil
import sys
import tempfile
import time
from io import BytesIO
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
from PIL import Image
from scipy.signal import butter, filtfilt

import jaxmotion as jm
from jaxmotion.viz.colours import BLUE, GREY, ORANGE
from jaxmotion.viz.picture import Picture

FOLDER = Path(__file__).with_suffix("")
NOTEBOOKS = Path(__file__).parents[1] / "notebooks"
COLOURS = 255  # of a file, one byte a pixel: curves and text need no more
DOUBLE = (
    "response",
    "orders",
    "style_phase",
    "sudden_moves",
    "unique_move",
)  # drawn in float64; noise drawn in float32 is another
NOISE = 0.05  # radians
BROWSER = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--no-first-run", "--disable-background-networking", "--disable-component-update"),
)
SEEN = "frame=118&paused"


def strip():
    """Before and after: a walk, and the same with its style doubled."""
    walk = jm.samples.load("walk", num_frames=107).motion
    lively = jm.stylize(walk, alpha=2.0, keep_contacts=True)
    clips = {"as captured": walk, "style doubled, contacts kept": lively}
    return jm.viz.plot_poses(clips, count=9)


def layers():
    """A forearm of a noisy walk taken apart, the noise learned."""
    _, noisy = walk_and_noisy()
    return jm.viz.plot_layers(jm.decompose(noisy, tune="evidence"), "LeftForeArm")


def tuning():
    """What a cut-off costs, and what learning λ and σ of every joint gives."""
    walk, noisy = walk_and_noisy()
    return jm.viz.plot_denoising_error(
        walk,
        noisy,
        filters={"Butterworth, both ways": butterworth},
        denoised={"jm.denoise, λ and σ learned": jm.denoise(noisy)},
    )


def mirrored():
    """A kick of the right leg, and of the left."""
    kick = jm.samples.load("kick").motion
    clips = {"a kick": kick[20:140], "mirrored": jm.mirror(kick)[20:140]}
    return jm.viz.plot_poses(clips, count=7, view="front")


def walk_and_noisy():
    walk = jm.samples.load("walk", num_frames=181).motion
    return walk, jm.samples.add_noise(walk, jax.random.key(0), rotation=NOISE).motion


def butterworth(motion, cutoff):
    """Order 2, forward and backward over quaternions of aligned signs."""
    q = np.asarray(jm.quaternion.align_signs(motion.rotations))
    smooth = filtfilt(*butter(2, cutoff, fs=float(motion.fps)), q, axis=0)
    unit = smooth / np.linalg.norm(smooth, axis=-1, keepdims=True)
    return motion.with_transforms(rotations=jnp.asarray(unit, motion.dtype))


def response():
    """What the smoother leaves of a swing, by its frequency, measured; and where half is left."""
    figure = Picture(figsize=(9.0, 3.2), layout="constrained")
    axes = figure.add_subplot()
    rate, frames = 60.0, 4096
    pulse = np.zeros(frames)
    pulse[frames // 2] = 1.0
    hertz = np.fft.rfftfreq(frames, 1 / rate)
    for product, shade in zip((1, 10, 100, 1000), (BLUE, ORANGE, GREY, "black"), strict=True):
        left = np.abs(np.fft.rfft(np.asarray(jm.smoothing.lgs(pulse, float(product), 1.0).mean)))
        axes.semilogx(hertz[1:], left[1:], color=shade, label=f"λσ = {product}")
        half = rate / np.pi * np.arcsin(1 / np.sqrt(2 * product))
        axes.plot(half, 0.5, "o", color=shade)
        where = {"xytext": (5, 5), "textcoords": "offset points"}
        axes.annotate(f"{half:.2g} Hz", (half, 0.5), color=shade, **where)
    axes.set(xlabel="hertz, at 60 frames a second", ylabel="share that is left", xlim=(0.05, 30))
    axes.set_xticks([0.1, 1, 10], ["0.1", "1", "10"])
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(frameon=False, ncols=4, loc="outside lower center")
    return figure


def cutoffs():
    """A knee of a noisy walk at four λσ."""
    walk, noisy = walk_and_noisy()
    joint = walk.skeleton.index("LeftLeg")

    def bend(clip):
        return np.degrees(np.asarray(jm.quaternion.log(clip.rotations[:, joint]))[:, 0])

    figure = Picture(figsize=(9.0, 4.2), layout="constrained")
    for axes, product in zip(
        figure.subplots(2, 2, sharex=True, sharey=True).flat, (1, 10, 100, 1000), strict=True
    ):
        times = np.asarray(walk.times)
        axes.plot(times, bend(noisy), color=ORANGE, lw=0.8, label="captured")
        axes.plot(times, bend(walk), color=GREY, lw=4, label="the truth")
        smooth = jm.smoothing.smooth_motion(noisy, float(product), 1.0)
        axes.plot(times, bend(smooth), color=BLUE, label="smoothed")
        half = float(walk.fps) / np.pi * np.arcsin(1 / np.sqrt(2 * product))
        axes.set_title(f"λσ = {product}: half at {half:.2g} Hz", loc="left", size="medium")
        axes.margins(x=0)
        axes.spines[["top", "right"]].set_visible(False)
    for axes in figure.axes[2:]:
        axes.set_xlabel("seconds")
    figure.supylabel("left knee, degrees", size="medium")
    handles = axes.get_legend_handles_labels()
    figure.legend(*handles, frameon=False, ncols=3, loc="outside lower center")
    return figure


def orders():
    """A walk on a curve whose base alone is turned: the pyramid, and ones of Euler angles."""
    walk = jm.samples.load("walk", num_frames=129, turning=0.6).motion
    return jm.viz.plot_invariance(walk, 5, orders=("XYZ", "ZXY", "YXZ", "YZX"))


def digression():
    """A walk with errors, and what was found in it."""
    _, _, found = cleaned()
    return jm.viz.plot_digression(found.errors)


def knee():
    """Of the same walk the knee where a gap was filled the short way."""
    walk, broken, found = cleaned()
    joint = walk.skeleton.index("LeftLeg")
    figure = Picture(figsize=(9.0, 2.8), layout="constrained")
    axes = figure.add_subplot()
    for clip, look in (
        (walk, {"color": GREY, "lw": 5, "label": "as it was"}),
        (broken, {"color": ORANGE, "label": "damaged"}),
        (found.motion, {"color": BLUE, "label": "repaired"}),
    ):
        bend = np.degrees(np.asarray(jm.quaternion.log(clip.rotations[:, joint]))[:, 0])
        axes.plot(np.asarray(walk.times), bend, **look)
    axes.set(xlabel="seconds", ylabel="left knee, degrees")
    axes.margins(x=0)
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(frameon=False, ncols=3, loc="outside lower center")
    return figure


def cleaned():
    walk = jm.samples.load("walk", fps=30.0, num_frames=180).motion
    joint = walk.skeleton.index("LeftLeg")
    key = jax.random.key(15)
    gap = jm.samples.fill_gaps(walk, key, runs=1, length=(20, 20), joints=[joint])
    broken = jm.samples.inject_errors(gap.motion, jax.random.key(2), runs=1).motion
    return walk, broken, jm.cleaning.repair(broken)


def style_phase():
    """Knee and hip of a walk, a run, and the walk in the run's manner."""
    return notebook("style_phase").draw()


def sudden_moves():
    """A toe that flicks, denoised both ways."""
    script = notebook("sudden_moves")
    return script.draw(*script.made_up())


def unique_move():
    """A bow beside itself and beside others."""
    folder = Path(__file__).parents[1] / "benchmarks" / "papers"
    sys.path.append(str(folder))
    return module_of(folder / "aristidou_figure_9.py").draw(0)


def player():
    """The player with the same walk before and after, as Chromium shows it."""
    from selenium import webdriver

    _, broken, found = cleaned()
    contacts = {"after": jm.contacts.detect(found.motion)}
    page = jm.viz.player(
        {"before": broken, "after": found.motion},
        contacts=contacts,
        errors={"before": found.errors},
        picked=["LeftLeg"],
        theme="light",
    )
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or ""
    for flag in BROWSER:
        options.add_argument(flag)
    driver = webdriver.Chrome(options, webdriver.ChromeService(shutil.which("chromedriver")))
    try:
        with tempfile.TemporaryDirectory() as folder:
            page.save(f"{folder}/walk.html")
            size = {"width": 800, "height": 560, "deviceScaleFactor": 1, "mobile": False}
            driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
            driver.get(f"file://{folder}/walk.html#{SEEN}")
            time.sleep(1.0)  # drawn, and all that moves at first at rest
            return BytesIO(driver.get_screenshot_as_png())
    finally:
        driver.quit()


def notebook(name):
    return module_of(NOTEBOOKS / f"{name}.py")


def module_of(path):
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PICTURES = {
    draw.__name__: draw
    for draw in (
        *(strip, layers, tuning, mirrored, response, cutoffs, orders, digression, knee),
        *(style_phase, sudden_moves, player, unique_move),
    )
}


def write(picture, path):
    """A figure, or a picture that is drawn already, as PNG of few colours, which is a third of the
    size."""
    file = picture
    if isinstance(picture, Picture):
        file = BytesIO()
        picture.savefig(file, format="png", dpi=100)
    image = Image.open(file).convert("RGB")
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)


def main(names=(), folder=FOLDER):
    if unknown := set(names) - set(PICTURES):
        raise SystemExit(f"no picture {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    folder.mkdir(exist_ok=True)
    for name in names or PICTURES:
        jax.config.update("jax_enable_x64", name in DOUBLE)
        write(PICTURES[name](), folder / f"{name}.png")


if __name__ == "__main__":
    main(sys.argv[1:])
