"""Opens a run's dataset again, with the stored restorations of its views.

The folder's config.yaml has the dataset, its options and its degradation, as the last command used them. Rows say which
views a method restored, and the id of their data. A picture has 8 bits; black in it stands for no colour (see
`sucre_bench.imaging.encoding.to_8bit`).
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench.arrays import Picture
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit

if TYPE_CHECKING:
    from sucre_bench.jobs.job import Job
    from sucre_bench.results.layout import Place
    from sucre_bench.scene import View

# What stands for the view itself where a method's label is asked for.
INPUT = "input"


@dataclass(frozen=True, eq=False)
class Frame:
    """A view, and where the pictures that methods made of it are kept. out: the folder of results."""

    view: View
    place: Place
    out: Path

    def picture(self, method: str) -> Picture:
        """Return what a method made of the view, (H, W, 3) uint8 RGB, or the view itself for "input".

        Raises InputError when the picture cannot be read, or is not of the view's size.
        """
        from sucre_bench.results.restorations import stored_picture

        rgb = self.view.rgb
        if method == INPUT:
            return to_8bit(display(rgb, "none", self.view.encoding))
        return stored_picture(self.out, self.place, method, rgb.shape[:2])


@dataclass(frozen=True, eq=False)
class Revisited:
    """A scene of a run, as far as all chosen methods restored it.

    dataset: its label; scene: its name in rows; frames: in capture order; left_out: views that some method lacks.
    """

    dataset: str
    scene: str
    frames: tuple[Frame, ...]
    left_out: int


def revisit(out: Path, methods: Sequence[str], dataset: str = "", scene: str = "") -> Revisited:
    """Open the data of a run again, and find what methods made of them; pixels stay unread.

    methods: labels, or "input" for the views themselves; dataset, scene: may be left out where there is only one.
    Raises InputError for a label or scene that the results do not have. Also if config.yaml names another dataset, or
    if the data are no longer those that were restored.
    """
    from sucre_bench import results
    from sucre_bench.engine.preflight import open_scenes, tasks
    from sucre_bench.results.rows import restorations

    rows = restorations(results.read(out))
    known = {*rows["method"], INPUT}
    for method in methods:
        if method not in known:
            raise InputError(f"method '{method}': no results of it; {did_you_mean(method, known)}")

    def restored_by_all(column: str) -> set[str]:
        by_method = (set(rows.loc[rows["method"] == method, column]) for method in methods if method != INPUT)
        return set(rows[column]).intersection(*by_method)

    dataset = _only("dataset", restored_by_all("dataset"), dataset, out)
    rows = rows[rows["dataset"] == dataset]
    scene = _only("scene", restored_by_all("scene"), scene, out)
    rows = rows[rows["scene"] == scene]
    job = _job(out, dataset, scene)
    try:
        opened = [task for task in tasks(job, open_scenes(job.dataset)) if task.base.scene == scene]
    except InputError as fault:
        where = f"{out / 'config.yaml'} says where the data are, seen from where the run was started"
        raise InputError(f"{fault} ({where})") from fault
    restored = restored_by_all("view")
    frames = [Frame(task.view, task.place, out) for task in opened if task.view.name in restored]
    if not frames:
        raise InputError(f"no view of '{scene}' was restored by {' and '.join(methods)}", out, "run them on the same")
    chosen = rows["method"].isin(methods) if set(methods) - {INPUT} else slice(None)
    if stale := set(rows.loc[chosen, "data_id"]) - {task.base.data_id for task in opened}:
        raise InputError(
            f"{out}: the data of '{dataset}' have changed since the run (data {', '.join(sorted(stale))} then); "
            "repeat the run's command"
        )
    return Revisited(dataset, scene, tuple(frames), rows["view"].nunique() - len(frames))


def _only(what: str, restored: Collection[str], given: str, out: Path) -> str:
    """The one that is given, or the only one of which every method restored something."""
    known = sorted(restored)
    if given and given not in known:
        raise InputError(f"{what} '{given}': not in {out} with these methods; {did_you_mean(given, known)}")
    if not given and len(known) != 1:
        hint = f"choose one: --{what} {' or '.join(known)}" if known else f"run these methods on the same {what}"
        raise InputError(f"{len(known) or 'no'} {what}s have results of these methods", out, hint)
    return given or known[0]


def _job(out: Path, dataset: str, scene: str) -> Job:
    """A job of the dataset that the results are of, with all its views."""
    from sucre_bench.jobs.job import CONFIG, read_config
    from sucre_bench.results.rows import unreplicated

    _, replicate = unreplicated(scene)
    path = out / CONFIG
    labels = []
    for job in read_config(path):
        if job.dataset.label == dataset and job.replicate == replicate:
            return job.of_all_views()
        labels.append(job.dataset.label)
    told = ", ".join(dict.fromkeys(labels))
    raise InputError(
        f"{path}: the last run was of '{told}', not of '{dataset}' with scene '{scene}'; "
        "repeat the command of that run, which computes nothing again"
    )
