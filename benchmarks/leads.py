"""False leads and power of the intervals of `compare`, in simulated tables of which it is known who is better.

Run: python benchmarks/leads.py --tables 400. A line has a case:

- false: share of tables in which the best method differs by more than chance from one that is as good, by views taken
  as independent, and as a track, corrected for neighbours that are alike;
- found: share of tables in which a true difference of 1.5 standard deviations is found, likewise.

Scores are normal. The number after "alike" is the correlation of neighbouring views. A method that fails gains 1.5
standard deviations in nine of ten views, and loses as much in the tenth as makes it equal in the mean.

Below `FEWEST_FOR_LEAD` views, `compare` names no leader, whatever differs by more than chance: these lines end in "no
lead".
"""

from __future__ import annotations

import argparse

import numpy as np

from sucre_bench.compare.model import FEWEST_FOR_LEAD
from sucre_bench.compare.statistics import Units, leads

EFFECT = 1.5  # of the standard deviation of a paired difference
FAILS = 0.1  # in which share of views a method fails
LOSS = EFFECT / FAILS  # by how much


def series(n: int, methods: int, alike: float, rng: np.random.Generator) -> np.ndarray:
    """(V, M): a paired difference has a standard deviation of 1; neighbours have the correlation `alike`."""
    views = rng.normal(size=(n, methods))
    for v in range(1, n):
        views[v] = alike * views[v - 1] + np.sqrt(1 - alike**2) * views[v]
    return np.asarray(views / np.sqrt(2))


def leader(views: np.ndarray, units: Units) -> tuple[int, np.ndarray]:
    """The best method, and which methods it leads."""
    mean = views.mean(axis=0)
    best = int(mean.argmax())
    return best, mean[best] - mean > leads(units, best)


def case(
    name: str, n: int, methods: int, alike: float, tables: int, is_fragile: bool = False
) -> None:
    """Print a line."""
    rng = np.random.default_rng(0)
    false, found = np.zeros(2), np.zeros(2)
    for _ in range(tables):
        equal = series(n, methods, alike, rng)
        if is_fragile:  # as good in the mean, by collapsing in few views
            equal[:, 0] += EFFECT - LOSS * (rng.random(n) < FAILS)
        better = series(n, methods, alike, rng)
        better[:, 0] += EFFECT
        for k, in_order in enumerate((False, True)):
            false[k] += leader(equal, Units.of(equal, [n], in_order))[1].any()
            units = Units.of(better, [n], in_order)
            best, behind = leader(better, units)
            found[k] += best == 0 and behind[1:].any()
    shares = (*(false / tables), *(found / tables))
    print(
        f"{name:<36}{n:>4}{methods:>9}"
        + "".join(f"{share:>11.3f}" for share in shares)
        + ("  no lead" if n < FEWEST_FOR_LEAD else ""),
        flush=True,
    )


def scenes(sizes: list[int], methods: int, between: float, tables: int) -> None:
    """Print a line of scenes of these sizes; between: standard deviation of scenes beside that of views, 1."""
    rng, false = np.random.default_rng(0), 0
    for _ in range(tables):
        of_scenes = np.repeat(between * rng.normal(size=(len(sizes), methods)), sizes, axis=0)
        views = of_scenes + rng.normal(size=(sum(sizes), methods))
        false += bool(leader(views, Units.of(views, sizes))[1].any())
    print(
        f"scenes of {sizes} views, between {between:<12}{methods:>5}{'':>11}{false / tables:>11.3f}",
        flush=True,
    )


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--tables", type=int, default=400, help="simulated tables of a case")
    n_tables = parser.parse_args().tables
    heads = ("false", "track", "found", "track")
    print(f"{'case':<36}{'n':>4}{'methods':>9}" + "".join(f"{head:>11}" for head in heads))
    for alike in (0.0, 0.5, 0.8):
        for n in (4, 8, 20, 40):
            for methods in (2, 6, 18):
                case(
                    f"neighbours alike by {alike}",
                    n,
                    methods,
                    alike,
                    n_tables if methods < 18 else n_tables // 4,
                )
    for n in (4, 8, 12, 20, 40):
        for methods in (2, 6):
            case("one method fails in 1 of 10", n, methods, 0.0, n_tables, is_fragile=True)
    for sizes in ([4] * 4, [2, 3, 12, 30], [1, 2, 4, 20], [2, 3, 5, 12, 8, 4]):
        for between in (1.0, 0.0):
            for methods in (2, 5):
                scenes(sizes, methods, between, n_tables)
