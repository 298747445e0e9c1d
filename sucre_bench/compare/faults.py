"""The faults of each method's pictures, in the words that metrics declare for them (`plugins.Fault`)."""

from collections.abc import Iterator, Mapping

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare.model import Note
from sucre_bench.plugins.plugin import Fault
from sucre_bench.results.rows import values_of

# A method has a fault if more than this share of its views has it.
_FEW = 0.2


def metrics_of_faults(rows: DataFrame) -> dict[str, Mapping[str, Fault]]:
    """Return the faults that the metrics of rows declare, by metric: tables say them in words, and have no column."""
    known = {str(name): plugins.installed("metric", str(name)) for name in rows["metric"].unique()}
    return {name: plugin.faults for name, plugin in known.items() if plugin and plugin.faults}


def fault_notes(rows: DataFrame) -> Iterator[Note]:
    """Yield a note for each method whose pictures have faults. rows: of one table, with `_fresh`."""
    metrics = metrics_of_faults(rows)
    scored = rows[rows["_fresh"] & (rows["status"] == "ok") & rows["metric"].isin(metrics)]
    for method, of_method in scored.groupby("method", sort=False):
        said = []
        for (metric, variant), values in of_method.groupby(["metric", "variant"], sort=False):
            fault = metrics[str(metric)].get(str(variant))
            whole = values[values["region"] == "image"]
            if fault is None or not (n := (is_bad := whole["value"] > fault.limit).sum()) > _FEW * len(whole):
                continue
            bad = set(values_of(whole[is_bad], "scene", "view"))
            parts = values[[place in bad for place in values_of(values, "scene", "view")]]
            hues = parts["region"][parts["region"] != "image"].str.removeprefix("image/").mode()
            share = f"{100 * whole.loc[is_bad, 'value'].mean():.0f} %"
            words = fault.words.format(share=share, hue=hues.iloc[0] if len(hues) else "")
            said.append(words + (f" in {n} of {len(whole)} views" if n < len(whole) else ""))
        if said:
            yield Note("faults", (str(method),), reasons=", ".join(said))
