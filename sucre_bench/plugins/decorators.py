"""The decorators that make a frozen dataclass a plugin."""

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import is_dataclass
from typing import Any, Literal, TypeVar

from sucre_bench.arguments import checked
from sucre_bench.errors import PluginError, did_you_mean
from sucre_bench.imaging.display import normalisation
from sucre_bench.plugins.plugin import NEEDS, Better, Fault, Kind, Plugin, Role
from sucre_bench.scene import HAS

_C = TypeVar("_C", bound=type[Any])


def _decorator(kind: Kind, name: str, needs: Iterable[str], **about: Any) -> Callable[[_C], _C]:
    needs, known = frozenset(needs), NEEDS if kind == "metric" else NEEDS - {"restoration", "restored_views"}
    if needs - known:
        raise PluginError(f"unknown needs {sorted(needs - known)}", kind, did_you_mean(min(needs - known), known))

    def attach(cls: _C) -> _C:
        if not is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            raise PluginError("not a frozen dataclass", cls.__qualname__, f"put @dataclass(frozen=True) under @{kind}")
        if kind == "metric" and not hasattr(cls, wanted := "score_pair" if "restored_views" in needs else "score"):
            raise PluginError(f"has no {wanted}()", cls.__qualname__, "see docs/plugins.md, A metric")
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
    - differs: how its pictures differ from those of its publication, where they do. `list` and tables say so;
    - opinions: what people thought of its pictures in published studies, their mean score by study. A table of several
      methods of one study shows them.

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
        raise PluginError("encoding=gamma is for methods of one view", "method", "other views are given as they are")
    about: dict[str, Any] = {"display": display, "encoding": encoding, "reads": tuple(reads)}
    about |= {"is_photograph": is_photograph, "may_use": tuple(may_use), "differs": differs, "opinions": opinions or {}}
    return _decorator("method", name, needs, requires=tuple(requires), cites=cites, licence=licence, **about)


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
    if unknown := (has := frozenset(has)) - HAS:
        raise PluginError(f"unknown has {sorted(unknown)}", "dataset", did_you_mean(min(unknown), HAS))
    about: dict[str, Any] = {"source": source, "proven": proven, "has": has, "charts_file": charts_file}
    about["signs"] = tuple(signs)
    return _decorator("dataset", name, (), requires=tuple(requires), cites=cites, licence=licence, **about)


@checked
def metric(
    *,
    variants: Mapping[str, str],
    unit: str,
    better: Better,
    range: tuple[float, float],
    name: str = "",
    needs: Iterable[str] = (),
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

    - variants: each variant's name, and what is different about it;
    - unit: the unit as tables print it;
    - better: "higher", "lower", or "none" for a metric that only describes;
    - range: least and greatest value. (0, 360) with the unit "deg" means angles of a full turn: 0 and 360 are the same;
    - name: the metric's name; default the class name in snake_case;
    - needs: what a scene must have, as for a method. "restoration": the metric needs more than a picture.
      "restored_views": the metric compares pairs of views, and has ``score_pair(pair, variant)``;
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
    >>> @sb.metric(variants={"mean": "mean of the red channel"}, unit="", better="none", range=(0, 1))
    ... @dataclass(frozen=True)
    ... class Redness:
    ...     '''How red the restored image is.'''
    ...     def score(self, restored, shown, view, variant):
    ...         red = shown[..., 0][restored.valid]
    ...         yield sb.Score(float(red.mean()), n_pixels=red.size)
    >>> Redness.__plugin__.default
    ('mean',)
    """
    chosen = tuple(default) or tuple(variants)[:1]
    about: dict[str, Any] = {"unit": unit, "better": better, "range": range, "variants": dict(variants)}
    about |= {"default": chosen, "role": role, "symbol": symbol, "unranked": frozenset(unranked)}
    about["faults"] = faults or {}
    about["agreement"] = dict(agreement or {})
    return _decorator("metric", name, needs, requires=tuple(requires), cites=cites, licence=licence, **about)


def snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()
