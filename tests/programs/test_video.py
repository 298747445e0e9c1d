"""Before/after videos: what frames hold, what files keep of them; and flicker, where it is known."""

import json
import math
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from support.command_line import registry
from support.made_results import make_frame, plain, wall_view
from support.messages import refused
from support.places import TOYS

from sucre_bench import Arrays, View, plugins
from sucre_bench.commands.look import video
from sucre_bench.engine.reopen_results import Frame
from sucre_bench.engine.run import run
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode, to_8bit
from sucre_bench.programs.video import composed, flicker, panel_size, write_video

G = 1.25


def noise(seed: int, low: float = 0.2, high: float = 0.7) -> np.ndarray:
    return np.random.default_rng(seed).uniform(low, high, (48, 64, 3))


def brightened(rgb: np.ndarray, gain: float | Sequence[float]) -> np.ndarray:
    """Encoded colours times a gain in linear light, 8 bit."""
    return to_8bit(srgb_encode(srgb_decode(rgb) * np.array(gain)))


def sequence(out: Path, gains: Sequence[float | Sequence[float]], *, geometry: bool = False) -> list[Frame]:
    """Views of different noise, restored by multiplying each by its gain."""
    frames = []
    for k, gain in enumerate(gains):
        rgb = noise(k)
        view = wall_view(f"{k}.png", rgb) if geometry else View(f"{k}.png", Arrays(rgb))
        frames.append(make_frame(out, view, restored=brightened(rgb, gain)))
    return frames


def test_a_gain_that_alternates_flickers_by_its_logarithm(tmp_path: Path):
    found = flicker(sequence(tmp_path, [1, G, 1, G, 1]), ["restored"])["restored"]["gain"]
    assert found.mean == pytest.approx(math.log(G), abs=2e-3)
    assert found.pairs == 4
    assert found.high - found.low < 5e-3


def test_a_gain_of_one_channel_counts_a_third(tmp_path: Path):
    found = flicker(sequence(tmp_path, [1, (G, 1, 1), 1]), ["restored"])["restored"]["gain"]
    assert found.mean == pytest.approx(math.log(G) / 3, abs=2e-3)


def test_holes_say_nothing_of_a_methods_gain(tmp_path: Path):
    frames = []
    for k in range(3):
        rgb = noise(k)
        picture = brightened(rgb, G)
        picture[: 12 * k] = 0
        frames.append(make_frame(tmp_path, View(f"{k}.png", Arrays(rgb)), restored=picture))
    assert flicker(frames, ["restored"])["restored"]["gain"].mean < 2e-3


def test_a_picture_without_any_colour_gives_no_pair(tmp_path: Path):
    frames = [*sequence(tmp_path, [1, 1]), make_frame(tmp_path, View("b", Arrays(noise(9))), restored=plain((0, 0, 0)))]
    assert flicker(frames, ["restored"])["restored"]["gain"].pairs == 1


def test_points_differ_by_the_difference_of_their_colours(tmp_path: Path):
    import skimage.color

    shift = 4  # pixels: 4 * 2.005 / 40 m
    colours = np.random.default_rng(3).uniform(0.1, 0.9, (48, 64 + shift, 3))
    views = [wall_view("a.png", colours[:, :64]), wall_view("b.png", colours[:, shift:], x=shift * 2.005 / 40)]
    restored = [brightened(view.rgb, gain) for view, gain in zip(views, (1, 0.8), strict=True)]
    frames = [make_frame(tmp_path, view, restored=picture) for view, picture in zip(views, restored, strict=True)]
    found = flicker(frames, ["restored"])
    assert found["input"]["points"].mean < 0.01, "the input shows the same points with the same colours"
    assert "gain" not in found["input"]
    lab = [skimage.color.rgb2lab(picture / 255) for picture in restored]
    between = skimage.color.deltaE_ciede2000(lab[0][:, shift:], lab[1][:, :-shift])
    assert found["restored"]["points"].mean == pytest.approx(between.mean(), rel=0.02)
    assert 0 < found["restored"]["relative"].mean < 0.5


def test_relative_flicker_does_not_grow_with_contrast(tmp_path: Path):
    frames = []
    for k in range(2):
        gray = 0.5 + np.random.default_rng(k).normal(0, 0.02, (48, 64, 1)).repeat(3, axis=2)
        strong = to_8bit(0.5 + 4 * (gray - 0.5))
        frames.append(make_frame(tmp_path, wall_view(f"{k}.png", gray), weak=to_8bit(gray), strong=strong))
    found = flicker(frames, ["weak", "strong"])
    assert found["strong"]["points"].mean > 3 * found["weak"]["points"].mean
    assert found["strong"]["relative"].mean == pytest.approx(found["weak"]["relative"].mean, rel=0.05)


def test_points_need_depth_and_poses(tmp_path: Path):
    assert set(flicker(sequence(tmp_path, [1, G]), ["restored"])["restored"]) == {"gain"}
    with_geometry = flicker(sequence(tmp_path, [1, G], geometry=True), ["restored"])
    assert set(with_geometry["restored"]) == {"gain", "points", "relative"}


def test_the_interval_is_students_and_never_below_0(tmp_path: Path):
    """Gains of e^g: the flicker of consecutive views is the difference of their g."""
    for changes, name in (([0.11, 0.12, 0.13], "narrow"), ([0.1, 0.2, 0.3], "wide")):
        gains = np.exp(-np.cumsum([0, *changes]))
        found = flicker(sequence(tmp_path / name, gains), ["restored"])["restored"]["gain"]
        half = 4.302653 * np.std(changes, ddof=1) / math.sqrt(3)
        assert (found.mean, found.pairs) == (pytest.approx(np.mean(changes), abs=2e-3), 3)
        assert found.low == pytest.approx(max(0, np.mean(changes) - half), abs=4e-3)
        assert found.high == pytest.approx(np.mean(changes) + half, abs=4e-3)
    assert found.low == 0
    alone = flicker(sequence(tmp_path / "two", [1, G]), ["restored"])["restored"]["gain"]
    assert (alone.pairs, math.isnan(alone.low), math.isnan(alone.high)) == (1, True, True)


RED, GREEN = (200, 30, 20), (20, 180, 40)


def two_frames(out: Path) -> list[Frame]:
    """A gray view, and a wide one; restored red and green."""
    views = [View("a.png", Arrays(np.full((90, 120, 3), 0.5))), View("b.png", Arrays(np.full((60, 120, 3), 0.5)))]
    return [make_frame(out, v, warm=plain(RED, *v.rgb.shape[:2]), cold=plain(GREEN, *v.rgb.shape[:2])) for v in views]


def test_the_input_is_left_and_methods_follow_in_order(tmp_path: Path):
    frames = two_frames(tmp_path)
    first, second = composed(frames, ["cold", "warm"], panel_size(frames[0], 540), 10, split=False)
    assert first.shape == second.shape == (90, 3 * 120 + 2 * 4, 3)
    for picture in (first, second):
        assert picture[60, [60, 184, 308]].tolist() == [[128, 128, 128], [*GREEN], [*RED]]
    assert (second[80:, :120] == 0).all(), "a view of another shape is fitted, not stretched"
    assert (first[:12, :20] != first[60, 60]).any(), "a name stands in the corner"


def test_panels_are_shrunk_to_even_sizes_and_never_grown(tmp_path: Path):
    frame = make_frame(tmp_path, View("a.png", Arrays(np.full((271, 481, 3), 0.5))))
    assert panel_size(frame, 100) == (176, 100)
    assert panel_size(frame, 1080) == (480, 270)


def test_the_divider_moves_and_parts_input_and_method(tmp_path: Path):
    frames = two_frames(tmp_path)[:1] * 4
    pictures = list(composed(frames, ["warm"], (120, 90), 1, split=True))
    shares = [(picture[60] == 128).all(axis=-1).mean() for picture in pictures]
    assert shares[0] < 0.15
    assert shares[3] > 0.85
    assert shares == sorted(shares)
    assert pictures[1][60, -1].tolist() == [*RED]
    assert pictures[1].shape == (90, 120, 3)


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_video_is_read_back_with_its_colours_in_order(tmp_path: Path, suffix: str, capfd: pytest.CaptureFixture[str]):
    path = tmp_path / f"v{suffix}"
    assert write_video(path, (plain(colour, 96, 128) for colour in (RED, GREEN, RED, GREEN)), 5) == 4
    read = cv2.VideoCapture(str(path))
    assert read.get(cv2.CAP_PROP_FPS) == 5
    for colour in (RED, GREEN, RED, GREEN):
        found, picture = read.read()
        assert found
        assert np.abs(picture[..., ::-1].astype(int) - colour).mean() < 8
    assert not read.read()[0]
    assert list(tmp_path.iterdir()) == [path]
    assert capfd.readouterr().err == ""


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy scene as it is and darker; of the darker, a view is missing."""
    out = tmp_path_factory.mktemp("results")
    toys = str(TOYS)
    words = ["dataset=toy", "method=gain", f"out={out}", "metrics=[psnr]", "tracking.uri=off", "report=false"]
    with plugins.using(registry()):
        run([*words, "method.label=same", f"plugins=[{toys}]"], False)
        run([*words, "method.label=dark", "method.gain=0.5", "first=2", f"plugins=[{toys}]"], False)
        run([*words, "method.gain=0.5,0.8", f"plugins=[{toys}]"], True)
    return out


def test_the_command_writes_a_video_and_the_flicker_as_numbers(results: Path, tmp_path: Path):
    out = tmp_path / "v.mp4"
    words = [str(results), str(out), "--methods", "same,dark", "--plugin", str(TOYS)]
    done = CliRunner().invoke(video, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert "2 views (1 " in done.output
    assert cv2.VideoCapture(str(out)).get(cv2.CAP_PROP_FRAME_COUNT) == 2
    told = json.loads(Path(f"{out}.json").read_text())
    assert told["views"] == ["v0.png", "v1.png"]
    assert told["flicker"]["same"]["gain"] == {
        "mean": pytest.approx(0, abs=1e-6),
        "low": None,
        "high": None,
        "pairs": 1,
    }
    assert told["flicker"]["dark"]["gain"]["mean"] < 0.02
    assert set(told["flicker"]["dark"]) == set(told["formulae"])


def test_labels_are_parted_by_commas_though_they_may_hold_some(results: Path, tmp_path: Path):
    labels = "same, gain,gain=0.5,gain,gain=0.8,same"
    words = [str(results), str(tmp_path / "v.mp4"), "--methods", labels, "--plugin", str(TOYS)]
    done = CliRunner().invoke(video, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    told = json.loads((tmp_path / "v.mp4.json").read_text())
    assert list(told["flicker"]) == ["input", "same", "gain,gain=0.5", "gain,gain=0.8"]


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["v.avi", "--methods", "same"], {"v.avi", ".mp4", ".webm"}),
        (["v.mp4", "--methods", "sane"], {"method", "'sane'", "'same'"}),
        (["v.mp4", "--methods", ","], {"--methods", "label"}),
    ],
)
def test_wrong_words_are_named_in_one_line(results: Path, words: list[str], named: set[str]):
    with refused(*named):
        CliRunner().invoke(video, [str(results), *words], catch_exceptions=False)
