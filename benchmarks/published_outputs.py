"""Published outputs, scored beside the numbers that their publications print: the table of docs/formulas.md.

python benchmarks/published_outputs.py CLONES OUT [NAME ...]

CLONES has clones of the repositories, one folder each; a line says how to get those that are not there. NAME: only
these exhibits. OUT becomes a results folder, and OUT/published-against-measured.csv has the numbers.

published_outputs.yaml lists the exhibits: repositories with photographs, and with what authors made of them. The files
of an exhibit are laid out as `dataset=photos` and `method=precomputed` read them. Its line-up is written beside them.
"""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import yaml

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError, SucreBenchError, unknown_name
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import read_rgb, write_png
from sucre_bench.imaging.reference_images import psnr_of
from sucre_bench.imaging.resizing import Resizing, resized
from sucre_bench.loading.d5_charts import published_charts
from sucre_bench.machine import progress
from sucre_bench.machine.files import check_folder, check_results_folder, write_atomically
from sucre_bench.results import layout

PICTURES = "pictures"  # the folder in the results folder that has the files of each exhibit
_FILE = Path(__file__).with_suffix(".yaml")
_MOST_DB = 100.0  # of a view: equal pictures would make the mean over views infinite

# Where files lie: the name of a view -> a path with * in it, or "{stem}" -> a path with {stem} in it.
Files = Mapping[str, str]


@dataclass(frozen=True)
class Number:
    """A number of a publication, and how to compute it. The keys are those of published_outputs.yaml."""

    row: str
    score: str = ""
    against: str = ""
    published: str = ""
    view: str = ""
    add: float = 0.0
    as_jpeg: bool = False
    form: str = ""
    why: str = ""
    source: str = ""


@dataclass(frozen=True)
class Exhibit:
    """Photographs of one repository, and what authors made of them. The keys are those of published_outputs.yaml."""

    name: str
    repository: str
    photographs: Files
    numbers: tuple[Number, ...]
    licence: str = "none given"
    reference: Files = field(default_factory=dict)
    outputs: Mapping[str, Files] = field(default_factory=dict)
    alike: Sequence[str] = ()
    methods: tuple[Mapping[str, Any], ...] = ()
    dataset: Mapping[str, Any] = field(default_factory=dict)
    size: int = 0
    charts: bool = False
    photograph: str = ""
    output: Mapping[str, Any] = field(default_factory=dict)
    metrics: tuple[str, ...] = ()

    @property
    def remedy(self) -> str:
        """How to get its repository."""
        return f"git clone --depth 1 https://github.com/{self.repository}"

    def folder(self, repositories: Path) -> Path:
        """Return the folder of its repository. Raises InputError, with the command that fetches it, if it is absent."""
        owner, name = self.repository.split("/")
        for place in (name, self.repository, f"{owner}+{name}"):
            if (repositories / place).is_dir():
                return repositories / place
        raise InputError(
            "no such folder", repositories / name, f"cd {repositories}; {self.remedy}"
        )


def exhibits(names: Sequence[str] = ()) -> list[Exhibit]:
    """Return the exhibits, or those of these names. Raises InputError for an unknown name."""
    known = yaml.safe_load(_FILE.read_text(encoding="utf-8"))
    common = known.pop("all")

    def files(one: Any) -> Files:
        return {"{stem}": one} if isinstance(one, str) else dict(one)

    found = []
    for name in names or known:
        if name not in known:
            raise unknown_name(name, name, known, "exhibit")
        content = {"reference": {}, "outputs": {}, "methods": (), **common, **known[name]}
        content |= {plane: files(content[plane]) for plane in ("photographs", "reference")}
        content["numbers"] = tuple(Number(**number) for number in content["numbers"])
        content["outputs"] = {row: files(one) for row, one in content["outputs"].items()}
        content["methods"] = tuple(
            {"name": m} if isinstance(m, str) else m for m in content["methods"]
        )
        found.append(Exhibit(name, **content))
    return found


# -- the files of an exhibit ---------------------------------------------------------------------------------------


def lay_out(exhibit: Exhibit, repositories: Path, out: Path) -> Path:
    """Put the files of an exhibit into ``out/pictures/NAME``, and return the line-up that scores them.

    A file that needs no resizing is a hard link, or a copy. Methods that need a file which is not in `repositories` are
    left out, with a line. Raises InputError if the repository is absent, has none of the files, or nothing is left.
    """
    source, place = exhibit.folder(repositories), out / PICTURES / exhibit.name
    photographs, reference = (
        _found(source, exhibit.photographs),
        _found(source, exhibit.reference),
    )
    outputs = {row: _found(source, files) for row, files in exhibit.outputs.items()}
    if exhibit.alike:
        # theirs have other names: of each, the name of our picture with the same pixels
        ours, theirs = (_found(source, {"{stem}": pattern}) for pattern in exhibit.alike)
        known = {read_rgb(path).tobytes(): name for name, path in theirs.items()}
        names = {name: known.get(read_rgb(path).tobytes(), "") for name, path in ours.items()}
        outputs = {
            row: {names[k]: path for k, path in of.items() if names.get(k)}
            for row, of in outputs.items()
        }
    shown = set(photographs) & (set(reference) if reference else set(photographs))
    shown &= set().union(*outputs.values()) if outputs else shown
    methods = []
    for method in map(dict, exhibit.methods):
        if "model" in method and not (file := repositories / method["model"]).exists():
            made = "docs/doors.md, Networks of others, has the command that makes it"
            progress.say(
                f"{exhibit.name}: {method.get('label')} is left out, no file {file}; {made}"
            )
        else:
            methods.append(
                method | ({"model": str(file.resolve())} if "model" in method else {})
            )
    if not shown or not (outputs or methods):
        raise InputError(
            f"has nothing of {exhibit.name}", source, f"fetch all of it: {exhibit.remedy}"
        )
    folders = {"photographs": photographs, "photographs/reference": reference, **outputs}
    for folder, files in progress.track(folders.items(), f"files of {exhibit.name}"):
        is_resized = exhibit.size if folder.startswith("photographs") else 0
        for stem in sorted(shown & set(files)):
            _put(files[stem], place / folder, stem, is_resized)
    if exhibit.charts:
        known_charts = published_charts()
        images = {
            path.name: {
                chart.name: np.asarray(chart.corners).tolist()
                for chart in known_charts[path.stem]
            }
            for path in sorted((place / "photographs").iterdir())
            if path.stem in shown & set(known_charts)
        }
        content = json.dumps({"kind": "dgk", "images": images})
        write_atomically(place / "photographs" / "charts.json", content.encode())
    rows = [{**exhibit.output, "label": row, "folder": row} for row in outputs]
    forms = list(dict.fromkeys(number.score for number in exhibit.numbers if number.score))
    line_up = {
        "datasets": [
            {"name": "photos", "label": exhibit.name, "root": "photographs", **exhibit.dataset}
        ],
        "methods": [{"name": exhibit.photograph}, *rows, *methods],
        "metrics": forms or list(exhibit.metrics),
    }
    says = f"{exhibit.name}: {len(shown)} photographs of github.com/{exhibit.repository} (licence: {exhibit.licence})"
    text = f"# {says}\n{yaml.safe_dump(line_up, sort_keys=False, allow_unicode=True)}"
    write_atomically(place / "lineup.yaml", text.encode())
    return place / "lineup.yaml"


def _found(folder: Path, files: Files) -> dict[str, Path]:
    """The files of a repository, by the name of the view."""
    found: dict[str, Path] = {}
    for name, pattern in files.items():
        # re.escape writes a brace and a star with a backslash.
        first, *others = re.escape(pattern).replace(r"\*", "[^/]*").split(r"\{stem\}")
        regex = (
            "(?P=stem)".join([f"{first}(?P<stem>[^/]+){others[0]}", *others[1:]])
            if others
            else first
        )
        for path in sorted(folder.glob(pattern.replace("{stem}", "*"))):
            if fits := re.fullmatch(regex, path.relative_to(folder).as_posix()):
                found.setdefault(fits["stem"] if others else name, path)
    return found


def _put(source: Path, folder: Path, stem: str, size: int) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    target = folder / f"{stem}{'.png' if size else source.suffix}"
    read = source.stat()
    if target.exists():
        there = target.stat()
        # A picture that was brought to a size, or copied, has the time of what it was made of.
        is_as_old = there.st_mtime_ns == read.st_mtime_ns
        if target.samefile(source) or (is_as_old and (size or there.st_size == read.st_size)):
            return
    if size:
        with suppress(SucreBenchError):  # a picture that cannot be read has no row
            write_png(
                target,
                resized(to_8bit(read_rgb(source)), Resizing(size, "bilinear"))[..., ::-1],
            )
            os.utime(target, ns=(read.st_atime_ns, read.st_mtime_ns))
        return
    try:
        os.link(source, target)
    except OSError:  # of another file system, or an older one is there
        write_atomically(target, source.read_bytes())
        os.utime(target, ns=(read.st_atime_ns, read.st_mtime_ns))


# -- published against measured ------------------------------------------------------------------------------------


def compared(rows: DataFrame, out: Path) -> DataFrame:
    """Return a row a number: what is compared, the numbers as text, and why they differ.

    rows: the score table of `out`, which may have exhibits of earlier commands. A number without a score is left out.
    """
    shown = [exhibit for exhibit in exhibits() if exhibit.name in set(rows["dataset"])]
    lines = (
        line
        for exhibit in shown
        for number in exhibit.numbers
        for line in _line(exhibit, number, rows, out)
    )
    return pd.DataFrame(lines)


def _line(
    exhibit: Exhibit, number: Number, rows: DataFrame, out: Path
) -> Iterator[dict[str, Any]]:
    metric, _, variant = number.score.partition(":")
    if number.against:
        values = pd.Series(_agreement(exhibit, number, out), dtype=float)
    else:
        is_asked = (
            (rows["dataset"] == exhibit.name)
            & (rows["method"] == number.row)
            & (rows["metric"] == metric)
        )
        ok = rows[is_asked & (rows["variant"] == variant) & (rows["status"] == "ok")]
        ok = ok.loc[[number.view in ("", Path(name).stem) for name in ok["view"]]]
        depth = ok["region"].str.count("/")  # a chart's score, not those of its patches
        ok = ok[depth == depth.min()]
        values = ok.groupby("view", sort=False)["value"].mean()
    if not len(values):
        return
    measured = float(values.mean()) + number.add
    digits = len(number.published.partition(".")[2])
    off = measured - float(number.published or "nan")
    is_equal = abs(off) <= 0.5 * 10.0**-digits * (1 + 1e-9)
    off_text = "equal" if is_equal else f"{off:+.{digits}f}"
    yield {
        "exhibit": exhibit.name,
        "row": number.row,
        "score": f"against {number.against}, dB"
        if number.against
        else f"{number.score} {number.view}".rstrip(),
        "published": number.published,
        "measured": f"{measured:.{digits or 3}f}",
        "difference": off_text if number.published else "",
        "views": len(values),
        "form": number.form,
        "reason": "" if is_equal else number.why,
        "source": number.source or f"github.com/{exhibit.repository}",
    }


def _agreement(exhibit: Exhibit, number: Number, out: Path) -> dict[str, float]:
    """PSNR of a row's pictures against the published ones in 8 bits, dB, by view; at most `_MOST_DB`.

    as_jpeg: ours is first stored with the loss of the published JPEG file. Pictures that cannot be read are left out.
    """
    from PIL import Image, JpegImagePlugin

    ours = out / "restored" / layout.file_name(exhibit.name) / layout.file_name(number.row)
    found = {}
    for path in sorted((out / PICTURES / exhibit.name / number.against).glob("*")):
        if not (picture := ours / f"{path.stem}.png").is_file():
            continue
        try:
            with Image.open(picture) as our_file, Image.open(path) as their_file:
                one, other = our_file.convert("RGB"), their_file.convert("RGB")
                if number.as_jpeg and isinstance(their_file, JpegImagePlugin.JpegImageFile):
                    loss = {
                        "qtables": their_file.quantization,
                        "subsampling": JpegImagePlugin.get_sampling(their_file),
                    }
                    one.save(stored := io.BytesIO(), "JPEG", **loss)
                    one = Image.open(stored)
                if one.size == other.size:
                    off = (np.asarray(one, np.float64) - np.asarray(other, np.float64)) / 255
                    found[path.stem] = min(psnr_of(float((off**2).mean())), _MOST_DB)
        except (
            OSError,
            SyntaxError,
            ValueError,
            Image.DecompressionBombError,
        ) as fault:
            # SyntaxError: a damaged PNG
            progress.say(
                f"{exhibit.name}: {number.row} is not compared with {path.name}: {fault}"
            )
    return found


def main(repositories: Path, out: Path, names: Sequence[str]) -> None:
    """Lay out, run and compare the exhibits; print and write the table. Exit with 1 if a run failed."""
    check_folder(repositories, "give the folder that has the clones")
    check_results_folder(out)
    failed = False
    for exhibit in exhibits(names):
        try:
            line_up = lay_out(exhibit, repositories, out)
        except InputError as fault:
            print(f"{exhibit.name} is left out: {fault}")
            continue
        command = str(Path(sys.executable).with_name("sucre-bench"))
        words = [command, "run", str(line_up), f"out={out}", "tracking.uri=off"]
        failed |= subprocess.run(words, check=False).returncode != 0
    table = compared(results.read(out), out)
    table.to_csv(out / "published-against-measured.csv", index=False)
    print(table.to_string(index=False))
    sys.exit(failed)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3:])
