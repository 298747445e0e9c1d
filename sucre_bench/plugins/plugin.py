"""Methods, datasets and metrics: their protocols, `Plugin`, the record of one, and the decorators that attach it."""

import inspect
import math
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, is_dataclass
from types import MappingProxyType
from typing import Any, Literal, Protocol, TypeVar, get_args

from sucre_bench.arguments import checked
from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, Lack, PluginError, did_you_mean
from sucre_bench.imaging.display import normalisation
from sucre_bench.restored_pair import RestoredPair
from sucre_bench.scene import HAS, Restoration, Scene, Score, View

Better = Literal["higher", "lower", "none"]

# What a metric knows of the true colours. "truth": it compares with what is true; "evidence": its order of methods
# agrees with theirs by more than chance, on scenes that did not choose it; "taste": neither, so nobody wins by it.
Knows = Literal["truth", "evidence", "taste"]

# What figures and the page show of a metric beside its table: none knows a metric by its name.
Role = Literal[
    "",
    "chart-distance",  # of each chart from the camera, m
    "change-with-distance",  # of a point's colour between views: regions "image/0.5-1 m", of the difference in distance
    "chart-error",  # of a chart's patches against the expected colours, and their mean
    "colours",  # the computed colours against the true ones, whatever the display
    "colour-difference",  # the same, as a difference between colours that swatches show
    "coverage",  # share of pixels with a colour
    "diagnosis",  # how a method works, not how good its picture is
    "distance-variance",  # of a view's distances, m^2
    "no-reference",  # a picture alone: shown where there is neither reference nor chart
    "observations",  # how many a restoration used
    "patch-colour",  # measured and expected colour of a patch: variants "red" and "red-expected", and so on
    "patch-hue",  # measured and expected hue of a patch, degrees: variants NAME and "NAME-expected"
    "seams",  # steps in the picture that the photograph does not have
    "similarity",  # to the true colours
    "water-parameters",  # estimated water: variants "attenuation-red", and so on
]


Kind = Literal["method", "dataset", "metric"]


KINDS: tuple[Kind, ...] = get_args(Kind)


# What a scene may offer, and what only metrics need: "restoration", where just any picture makes no sense;
# "restored_views", where two restored views of a scene are scored together, see `PairMetric`.
NEEDS = HAS | {"restoration", "restored_views"}


@dataclass(frozen=True)
class Fault:
    """A fault of pictures: a score above `limit`."""

    limit: float

    words: str
    """What tables say of a picture with it. "{share}" stands for the score as a share, "{hue}" for the part behind
    "image/" of a second score's region."""

    definition: str
    """Of the score."""


class Method(Protocol):
    """Restores a view of a scene. Must not alter its inputs, and must give NaN where it has no colour."""

    def restore(self, scene: Scene, view: View) -> Restoration: ...


class Dataset(Protocol):
    """Yields scenes. Raises InputError, naming the file and the remedy, when the data are not as expected."""

    def scenes(self) -> Iterable[Scene]: ...


class Metric(Protocol):
    """Scores a restoration.

    restored.image is what the method computed; shown is the picture made of it, (H, W, 3) in [0, 1],
    gamma-encoded, NaN where there is no colour. Yields nothing where the view has nothing to score.
    """

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterable[Score]: ...


class PairMetric(Protocol):
    """Scores two restored views of a scene together; a metric with needs={"restored_views"}.

    It is called once for each pair of views that share points, in one order of the two. The score of a view is the mean
    over its pairs by `Score.weight`. Yields nothing for a pair that does not count; raises NotApplicableError with the
    reason why a method cannot be scored.
    """

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterable[Score]: ...


@dataclass(frozen=True)
class Plugin:
    """What is known of a plugin without running it."""

    kind: Kind
    name: str
    cls: type[Any]

    needs: frozenset[str] = frozenset()
    """What a scene must offer."""

    may_need: frozenset[str] = frozenset()
    """What a metric uses where a scene has it, see `metric`."""

    requires: tuple[str, ...] = ()
    """Packages that it imports when it runs."""

    may_use: tuple[str, ...] = ()
    """Packages that it imports for some options."""

    cites: str = ""
    licence: str = ""

    display: str = "none"
    """How a method's image is brought to the screen."""

    # Of a method, see `method`.
    encoding: Literal["any", "gamma"] = "any"
    reads: tuple[str, ...] = ()
    is_photograph: bool = False
    differs: str = ""
    opinions: Mapping[str, float] = field(default_factory=dict)

    # Of a dataset, see `dataset`.
    source: str = ""
    proven: str = ""
    has: frozenset[str] = frozenset()

    # Of a metric, see `metric`.
    unit: str = ""
    better: Better = "higher"
    range: tuple[float, float] = (-math.inf, math.inf)
    variants: Mapping[str, str] = field(default_factory=dict)
    default: tuple[str, ...] = ()
    role: Role = ""
    symbol: str = ""
    unranked: frozenset[str] = frozenset()
    faults: Mapping[str, Fault] = field(default_factory=dict)
    agreement: Mapping[str, float] = field(default_factory=dict)

    # Of a dataset, too.
    charts_file: str = ""
    signs: tuple[str, ...] = ()

    @property
    def is_of_pixels(self) -> bool:
        """Whether it ranks pictures by their pixels, so that methods must be compared on the same ones.

        A metric of charts does not, nor one of what the method computed besides the picture.
        """
        ranks = self.kind == "metric" and self.better != "none"
        return ranks and self.needs <= {"reference", "depth", "poses"}

    def knows(self, variant: str) -> Knows:
        """Return what a variant of a metric knows of the true colours."""
        if self.needs & {"reference", "charts", "truth"}:
            return "truth"
        return "evidence" if variant in self.agreement else "taste"

    def better_of(self, variant: str) -> Better:
        """Which direction of a variant's scores is better; "none" for a variant that only describes."""
        return "none" if variant in self.unranked else self.better

    @property
    def is_foreign(self) -> bool:
        """Whether it is of a file or package of others, so that it may end the process."""
        return not self.cls.__module__.startswith("sucre_bench.")

    @property
    def place(self) -> str:
        """What stands before its options in the words of a command."""
        return f"metrics.{self.name}" if self.kind == "metric" else self.kind

    @property
    def is_of_pairs(self) -> bool:
        """Whether it is a metric that scores pairs of restored views, see `PairMetric`."""
        return "restored_views" in self.needs

    @property
    def period(self) -> float:
        """After how much a metric's values begin anew: 360 for a hue, in deg from 0 to 360; infinite for any other."""
        return 360.0 if (self.unit, self.range) == ("deg", (0, 360)) else math.inf

    @property
    def summary(self) -> str:
        """The first sentence of the class's docstring."""
        return (inspect.getdoc(self.cls) or "").split("\n\n")[0].replace("\n", " ")


def plugin_of(made: object) -> Plugin:
    """Return the plugin that an object is made of. Raises InputError for an object of any other class."""
    plugin = getattr(made, "__plugin__", None)
    if not isinstance(plugin, Plugin) or isinstance(made, type):
        if isinstance(made, type):
            remedy = f"pass an object: {made.__name__}(...)"
            raise InputError("is a class", made.__name__, remedy)
        kinds = "a class under @method, @dataset or @metric"
        raise InputError(
            "is no plugin", type(made).__name__, f"pass a name, or an object of {kinds}"
        )
    return plugin


@dataclass(frozen=True)
class Broken:
    """A plugin that cannot be used, and why."""

    name: str
    reason: str


def missing_needs(
    plugin: Plugin, has: frozenset[str], of: Literal["scene", "view"] = "scene"
) -> str:
    """Return what a plugin needs and a scene or view does not have, as the text of a `Lack`; empty if it has all."""
    absent = plugin.needs - has
    return str(Lack(tuple(sorted(absent)), tuple(sorted(has)), of)) if absent else ""


# -- the decorators ------------------------------------------------------------------------------------------

_C = TypeVar("_C", bound=type[Any])


def _decorator(kind: Kind, name: str, needs: Iterable[str], **about: Any) -> Callable[[_C], _C]:
    needs = frozenset(needs)
    known = NEEDS if kind == "metric" else NEEDS - {"restoration", "restored_views"}
    if needs - known:
        raise PluginError(
            f"unknown needs {sorted(needs - known)}",
            kind,
            did_you_mean(min(needs - known), known),
        )

    def attach(cls: _C) -> _C:
        if not is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            raise PluginError(
                "not a frozen dataclass",
                cls.__qualname__,
                f"put @dataclass(frozen=True) under @{kind}",
            )
        if kind == "metric" and not hasattr(
            cls, wanted := "score_pair" if "restored_views" in needs else "score"
        ):
            raise PluginError(
                f"has no {wanted}()", cls.__qualname__, "see docs/plugins.md, A metric"
            )
        cls.__plugin__ = Plugin(  # type: ignore[attr-defined]
            kind, name or snake_case(cls.__name__), cls, needs, **about
        )
        return cls

    return attach


@checked
def method(
    *,
    name: str = "",
    needs: Iterable[str] = (),
    requires: Iterable[str] = (),
    may_use: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
    display: str = "none",
    encoding: Literal["any", "gamma"] = "any",
    reads: Iterable[str] = (),
    is_photograph: bool = False,
    differs: str = "",
    opinions: Mapping[str, float] | None = None,
) -> Callable[[_C], _C]:
    """Make a method of a frozen dataclass with ``restore(scene, view)``.

    - name: the method's name; default the class name in snake_case;
    - needs: what a scene must have: "depth", "poses", "reference", "charts", "truth";
    - requires: import names of the packages that the method uses when it runs;
    - may_use: those that it uses for some values of its options only. The method itself must check for them;
    - cites, licence: publication and licence of the method;
    - display: the normalisation that makes a picture of the result, see `sucre_bench.imaging.display.display`;
    - encoding: "gamma" if the method assumes gamma-encoded intensities. sucre_bench then encodes linear views (sRGB)
      before the call, and decodes the result;
    - reads: options that name a file, a folder or another method which affects the result, for example weights. When it
      changes, views are restored again;
    - is_photograph: the method returns the photograph itself. Tables show it, but it is never best or second;
    - differs: how its pictures differ from those of its publication, where they do. `list` says so;
    - opinions: what people thought of its pictures in published studies, their mean score by study; see `list`.

    Raises PluginError if the class is no frozen dataclass, or an argument is not allowed.

    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import sucre_bench as sb
    >>> @sb.method(cites="nobody")
    ... @dataclass(frozen=True)
    ... class LessBlue:
    ...     '''Scale the blue channel.'''
    ...     factor: float = 0.5
    ...     def restore(self, scene, view):
    ...         return sb.Restoration(view.rgb * np.float32([1, 1, self.factor]))
    >>> view = sb.View("a.png", sb.Arrays(np.full((48, 64, 3), 0.4)))
    >>> sb.restore(LessBlue(0.25), sb.Scene("reef", [view], frozenset()), "a.png").image[0, 0].tolist()
    [0.4000000059604645, 0.4000000059604645, 0.10000000149011612]
    """
    normalisation(display)
    needs = frozenset(needs)
    if encoding == "gamma" and "poses" in needs:
        raise PluginError(
            "encoding=gamma is for methods of one view",
            "method",
            "other views are given as they are",
        )
    return _decorator(
        "method",
        name,
        needs,
        requires=tuple(requires),
        may_use=tuple(may_use),
        cites=cites,
        licence=licence,
        display=display,
        encoding=encoding,
        reads=tuple(reads),
        is_photograph=is_photograph,
        differs=differs,
        opinions=opinions or {},
    )


@checked
def dataset(
    *,
    name: str = "",
    requires: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
    source: str = "",
    proven: str = "",
    has: Iterable[str] = (),
    charts_file: str = "",
    signs: Iterable[str] = (),
) -> Callable[[_C], _C]:
    """Make a dataset of a frozen dataclass with ``scenes()``.

    - name: the dataset's name; default the class name in snake_case;
    - requires: import names of the packages that the dataset uses when it runs;
    - cites, licence: publication and licence of the data;
    - source: where to get the data, and their size;
    - proven: which released files it has read; "": nothing is said of it;
    - has: what its scenes may have: "depth", "poses", "reference", "charts", "truth";
    - charts_file: the option that names its charts.json, relative to the option `root`. `sucre-bench charts` writes
      this file. "": the dataset has none;
    - signs: files or folders, as patterns of paths in `root`. ``dataset=FOLDER`` recognises the dataset by them.

    Raises PluginError if the class is no frozen dataclass, or an argument is not allowed.

    >>> from collections.abc import Iterator
    >>> from dataclasses import dataclass
    >>> import numpy as np
    >>> import sucre_bench as sb
    >>> @sb.dataset(licence="CC0")
    ... @dataclass(frozen=True)
    ... class GreenTank:
    ...     '''One green picture.'''
    ...     def scenes(self) -> Iterator[sb.Scene]:
    ...         view = sb.View("tank.png", sb.Arrays(np.full((48, 64, 3), [0.1, 0.4, 0.3])))
    ...         yield sb.Scene("tank", [view], frozenset())
    >>> GreenTank.__plugin__.name
    'green_tank'
    """
    has = frozenset(has)
    unknown = has - HAS
    if unknown:
        raise PluginError(
            f"unknown has {sorted(unknown)}", "dataset", did_you_mean(min(unknown), HAS)
        )
    return _decorator(
        "dataset",
        name,
        (),
        requires=tuple(requires),
        cites=cites,
        licence=licence,
        source=source,
        proven=proven,
        has=has,
        charts_file=charts_file,
        signs=tuple(signs),
    )


@checked
def metric(
    *,
    variants: Mapping[str, str] = MappingProxyType({"own": "the only one"}),
    unit: str = "",
    better: Better,
    range: tuple[float, float],
    name: str = "",
    needs: Iterable[str] = (),
    may_need: Iterable[str] = (),
    default: Iterable[str] = (),
    requires: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
    role: Role = "",
    symbol: str = "",
    unranked: Iterable[str] = (),
    faults: Mapping[str, Fault] | None = None,
    agreement: Mapping[str, float] | None = None,
) -> Callable[[_C], _C]:
    """Make a metric of a frozen dataclass with ``score(restored, shown, view, variant)``.

    - variants: each variant's name, and what is different about it; default one, "own";
    - unit: the unit as tables print it; default none;
    - better: "higher", "lower", or "none" for a metric that only describes;
    - range: least and greatest value, math.inf where there is none. (0, 360) with the unit "deg" means angles of a full
      turn: 0 and 360 are the same;
    - name: the metric's name; default the class name in snake_case;
    - needs: what a scene must have, as for a method. "restoration": the metric needs more than a picture.
      "restored_views": the metric compares pairs of views, and has ``score_pair(pair, variant)``;
    - may_need: what the metric uses where a scene has it, "charts" for example: its scores are then made again when the
      charts change;
    - default: the variants that are computed unless the user names others; default the first;
    - requires: import names of the packages that the metric uses when it runs;
    - cites, licence: publication and licence of its definition;
    - role: what tables, figures and the page use the metric for, besides its column (`Role` in plugin.py);
    - symbol: its name on the axis of a figure, with TeX between dollars; default name and unit;
    - unranked: variants that only describe: tables show them, but no method wins by them;
    - faults: variants that are faults of pictures. Tables say them in words, and have no column of them;
    - agreement: how well variants that need no truth agree with it: Kendall's tau (-1 to 1) between their order of
      methods and that of true colours, the mean over scenes. Only for those that agree by more than chance, on scenes
      that did not choose them. By other variants that need no truth, no method wins.

    Raises PluginError if the class is no frozen dataclass, or an argument is not allowed.

    >>> from dataclasses import dataclass
    >>> import sucre_bench as sb
    >>> @sb.metric(better="none", range=(0, 1))
    ... @dataclass(frozen=True)
    ... class Redness:
    ...     '''How red the restored image is.'''
    ...     def score(self, restored, shown, view, variant):
    ...         red = shown[..., 0][restored.valid]
    ...         yield sb.Score(float(red.mean()), n_pixels=red.size)
    >>> Redness.__plugin__.default
    ('own',)
    """
    return _decorator(
        "metric",
        name,
        needs,
        may_need=frozenset(may_need),
        requires=tuple(requires),
        cites=cites,
        licence=licence,
        unit=unit,
        better=better,
        range=range,
        variants=dict(variants),
        default=tuple(default) or tuple(variants)[:1],
        role=role,
        symbol=symbol,
        unranked=frozenset(unranked),
        faults=faults or {},
        agreement=dict(agreement or {}),
    )


def snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
