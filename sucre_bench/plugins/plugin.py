"""The protocols of methods, datasets and metrics, and `Plugin`, the record of one."""

import inspect
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Protocol, Union, get_args, get_origin

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, Lack
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
    """A fault of pictures: a score above `limit`.

    words: what tables say of a picture with it; "{share}" stands for the score as a share, "{hue}" for the part behind
    "image/" of a second score's region; definition: of the score.
    """

    limit: float
    words: str
    definition: str


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

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterable[Score]: ...


class PairMetric(Protocol):
    """Scores two restored views of a scene together; a metric with needs={"restored_views"}.

    It is called once for each pair of views that share points, in one order of the two. The score of a view is the mean
    over its pairs by `Score.weight`. Yields nothing for a pair that does not count; raises NotApplicableError with the
    reason why a method cannot be scored.
    """

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterable[Score]: ...


@dataclass(frozen=True)
class Plugin:
    """What is known of a plugin without running it.

    needs: what a scene must offer; requires, may_use: packages it imports when it runs, or for some options; display:
    how its image is brought to the screen, encoding, reads, is_photograph, differs, opinions: see `method`; source,
    proven, has, charts_file, signs: see `dataset`; unit, better, range, variants, default, role, symbol, unranked,
    faults, agreement: see `metric`.
    """

    kind: Kind
    name: str
    cls: type[Any]
    needs: frozenset[str] = frozenset()
    requires: tuple[str, ...] = ()
    may_use: tuple[str, ...] = ()
    cites: str = ""
    licence: str = ""
    display: str = "none"
    encoding: Literal["any", "gamma"] = "any"
    reads: tuple[str, ...] = ()
    is_photograph: bool = False
    differs: str = ""
    opinions: Mapping[str, float] = field(default_factory=dict)
    source: str = ""
    proven: str = ""
    has: frozenset[str] = frozenset()
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
        fault = f"is {made.__name__ if isinstance(made, type) else type(made).__name__}"
        raise InputError(fault, "method", "pass a name, or an object of a class under @method")
    return plugin


def fits(annotation: Any, value: Any) -> bool:
    """Whether a value has the type of an option; any word fits a Literal, and anything fits a type that is no option's.

    True and False are no numbers, and a whole number is a number.
    """
    origin, args = get_origin(annotation), get_args(annotation)
    if origin in (Union, UnionType):
        return any(fits(one, value) for one in args)
    if origin in (tuple, list) or origin is Sequence:
        return isinstance(value, (list, tuple)) and all(fits(args[0], one) for one in value)
    if annotation is float or annotation is int:
        return isinstance(value, (int, float) if annotation is float else int) and not isinstance(value, bool)
    if annotation in (str, Path) or origin is Literal:
        return isinstance(value, (str, Path))
    return not isinstance(annotation, type) or annotation not in (bool, type(None)) or isinstance(value, annotation)


@dataclass(frozen=True)
class Broken:
    """A plugin that cannot be used, and why."""

    name: str
    reason: str


def missing_needs(plugin: Plugin, has: frozenset[str], of: Literal["scene", "view"] = "scene") -> str:
    """Return what a plugin needs and a scene or view does not have, as the text of a `Lack`; empty if it has all."""
    absent = plugin.needs - has
    return str(Lack(tuple(sorted(absent)), tuple(sorted(has)), of)) if absent else ""
