"""The options of `sucre-bench run` and their defaults: `RunConfig`, the types of its keys, and launchers of sweeps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.plugins.options import (
    check_ranges,
    checked_options,
    default_values,
    options_of,
)
from sucre_bench.results.layout import file_name
from sucre_bench.results.rows import COSTS, By

T = TypeVar("T")


@dataclass
class Shard:
    """A part of the selected views: block `index` of `count` blocks of neighbouring views of almost equal size."""

    index: int = 0
    """Number of this block of views, from 0."""
    count: int = 1
    """Number of blocks that the views are split into; 1: all views in one block."""

    def __post_init__(self) -> None:
        if not 0 <= self.index < self.count:
            raise InputError(
                f"block {self.index} of {self.count}",
                "shard",
                "shard.index goes from 0 to shard.count - 1; "
                "run -m shard.count=8 'shard.index=range(8)' runs all blocks",
            )

    def of(self, items: Sequence[T]) -> Sequence[T]:
        """Return this block's items."""
        n = len(items)
        return items[n * self.index // self.count : n * (self.index + 1) // self.count]


# Each is a function in `reports.paper`.
Figure = Literal[
    "against", "charts", "hue", "pictures", "residuals", "scaling", "scores", "seams", "swatches",
    "validity", "water",
]  # fmt: skip
FIGURES: tuple[Figure, ...] = get_args(Figure)


@dataclass(frozen=True)
class Study:
    """The tables and figures that an experiment makes of the rows of a sweep."""

    name: str = ""
    """Of its files."""

    metrics: tuple[str, ...] = ()
    """As "name" or "name:variant", in the order of the table's columns; all when empty."""

    along: str = ""
    """The option whose values the study follows: "degrade.NAME", "dataset.NAME" or "method.NAME"."""

    axis: str = ""
    """What figures call that option, with its unit; the option's name when empty."""

    baseline: str = ""
    """The method that the others are measured against; the best when empty."""

    figures: tuple[str, ...] = ()
    """Names of functions in `reports.paper`."""

    spread: bool = False
    """Whether tables show standard deviations too."""

    svg: bool = False
    """Whether figures are written as .svg too."""

    by: By = "method"
    """With "view" or "region", a table for each is added."""

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> Study:
        """Read a study from a configuration. InputError for a name that is unknown, with the nearest."""
        given = {name: value for name, value in values.items() if value is not None}
        lists = {"metrics", "figures"} & given.keys()
        given |= {name: [given[name]] for name in lists if isinstance(given[name], str)}
        checked = checked_options(cls, given, "study")
        checked |= {name: tuple(dict.fromkeys(checked[name])) for name in lists}
        study = cls(**checked)
        if not study.name or file_name(study.name) != study.name:
            raise InputError(
                f"'{study.name}' is no name for files", "study.name", "give study.name=WORD"
            )
        for name, _, variant in (metric.partition(":") for metric in study.metrics):
            if name in COSTS:
                continue
            try:
                plugin = plugins.find("metric", name)
            except InputError as fault:
                raise fault.within("study.metrics") from fault
            if variant and split_variant(variant)[0] not in plugin.variants:
                raise unknown_name(
                    "study.metrics", variant, plugin.variants, f"variant of {name}"
                )
        for figure in study.figures:
            if figure not in FIGURES:
                raise unknown_name("study.figures", figure, FIGURES, "figure")
        group, _, option = study.along.partition(".")
        if study.along and not (option and group in ("degrade", "dataset", "method")):
            wrong = f"'{study.along}' is no option"
            raise InputError(
                wrong, "study.along", "give degrade.NAME, dataset.NAME or method.NAME"
            )
        if group == "degrade" and option not in (
            known := [f.name for f in fields(Degradation)]
        ):
            raise unknown_name("study.along", option, known, "option of degrade")
        return study


@dataclass
class Tracking:
    """Where mlflow logs the run."""

    uri: str = "${oc.env:MLFLOW_TRACKING_URI,sqlite:///${out}/mlflow.db}"
    """mlflow's tracking URI; the default is a store in the results folder, if mlflow is installed; off: no mlflow."""
    experiment: str = "${oc.env:MLFLOW_EXPERIMENT_NAME,sucre_bench}"
    """Name of the experiment in mlflow."""


# The options of a run that stand behind a word and a dot.
OPTION_GROUPS: dict[str, type[Any]] = {
    "degrade": Degradation,
    "shard": Shard,
    "tracking": Tracking,
}

Overwrite = Literal["missing", "failed", "always", "never"]
Colours = Literal["srgb", "stored"]
Save = Literal["display", "full"]


def check_group(key: str, value: Any, cls: type[Any], *more: str) -> None:
    """Raise InputError where one value was given in place of the options that a class has, and more."""
    if not isinstance(value, Mapping):
        known = ", ".join([*more, *(option.name for option in options_of(cls))])
        raise InputError("is a group of options", key, f"set one of them: {known}")


@dataclass(frozen=True)
class RunConfig:
    """The keys of `sucre-bench run`."""

    dataset: Any = field(default_factory=dict)
    """The dataset's name, label and options."""
    method: Any = field(default_factory=dict)
    """The method's name, label, display and options."""
    metrics: Any = field(default_factory=dict)
    """Each metric's name, variants and options."""
    out: Path = Path("outputs")
    """The results folder. A second run with the same folder adds to it."""
    views: str | Sequence[str] | None = None
    """Only these views, by name, or a .txt file with one name a line; null: all views."""
    every: int = 1
    """Only every Nth view; 1: every view."""
    first: int | None = None
    """Only the first N views; null: all views."""
    overwrite: Overwrite = "missing"
    """missing: restore views that have no result, failed, or are out of date; failed: also views at which the process
    died; always: all views; never: only views without a result."""
    view_timeout_s: float | None = None
    """Most seconds of a method for a view, and of a metric for a score; longer ones fail. null: no limit."""
    workers: int = 1
    """How many worker processes share the views of all jobs; 0: all in this process, for a debugger."""
    save: Save = "display"
    """display: write restored images; full: also J, B, beta and gamma (.npz), for metrics that you add later."""
    bits: int = 8
    """Bits a channel of restored images, 8 or 16."""
    colours: Colours = "srgb"
    """Of restored images. srgb: converted from the photographs' colour profile; stored: in that profile."""
    seed: int = 0
    """Seed of datasets and methods that draw random numbers."""
    report: bool = True
    """Write the page of the results folder; false: write none."""
    plugins: Sequence[str] = ()
    """Python files with plugins."""
    pairs_gb: float = 8.0
    """Most GB of disk for the pairs that the jobs of a sweep share while it runs; 0: share none."""
    cache_gb: float = 8.0
    """Most GB of disk for decoded images and depth maps while a run lasts; 0: decode files each time."""
    cache_keep: bool = False
    """Keep decoded images and depth maps in the results folder for the next run."""
    tracking: Tracking = field(default_factory=Tracking)
    """Where results are logged besides the table."""
    degrade: Degradation = field(default_factory=Degradation)
    """How the dataset is degraded before methods see it."""
    replicate: int = 0
    """Number of the repetition. Each has other random draws; comparisons average over them."""
    shard: Shard = field(default_factory=Shard)
    """A part of the views."""
    study: Study | None = None
    """The tables and figures that an experiment makes of its rows."""
    baseline: str = ""
    """Label of the method that the others are compared with; empty: the best method."""
    objective: str = ""
    """What optuna makes as good as it can, or another sweeper optimises: the mean of METRIC.VARIANT; empty: nothing."""

    def __post_init__(self) -> None:
        check_ranges(
            self,
            "",
            every="[1, inf)",
            first="[1, inf)",
            replicate="[0, inf)",
            pairs_gb="[0, inf)",
        )
        check_ranges(
            self, "", workers="[0, inf)", cache_gb="[0, inf)", view_timeout_s="(0, inf)"
        )
        if self.bits not in (8, 16):
            raise InputError(f"{self.bits}", "bits", "give bits=8 or bits=16")

    @classmethod
    def defaults(cls) -> dict[str, Any]:
        """Return the configuration of a run that is given nothing; the options in a group are a dictionary."""
        groups: dict[str, type[Any]] = {**OPTION_GROUPS, "study": Study}
        return default_values(cls) | {name: default_values(cls) for name, cls in groups.items()}

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> RunConfig:
        """Read a configuration. Raises InputError for an unknown option, or a value that is not acceptable."""
        made = dict(values)
        for name, group in OPTION_GROUPS.items():
            if name in made:
                check_group(name, made[name], group)
                made[name] = group(**checked_options(group, made[name], name))
        study = made.get("study")
        if study is not None:
            check_group("study", study, Study)
            made["study"] = None if study == default_values(Study) else Study.of(study)
        return cls(**checked_options(cls, made))
