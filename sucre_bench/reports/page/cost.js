// Time against quality.

import { $, choose, columnOf, data, directed, fill, shownMethods, state, watch } from "./page.js";
import { isKnown, number, withUnit } from "./words.js";
import { inked, isNarrow, label, legendBelow, ownColour, plot, signOf } from "./plots.js";

watch(["dataset", "metric"], () => {
  const scores = directed();
  fill(
    $("cost-metric"),
    scores.map((c) => [c.key, withUnit(c)]),
    scores.some((c) => c.key === state.metric) ? state.metric : (scores[0]?.key ?? ""),
  );
});
$("cost-metric").addEventListener("change", (event) => choose({ metric: event.currentTarget.value }));

watch(["dataset", "metric", "hidden", "theme"], () =>
  plot("cost-plot", () => {
    const column = columnOf($("cost-metric").value);
    const [at, seconds] = [data.columns.indexOf(column), data.columns.findIndex((c) => c.key === "seconds:wall")];
    if (!column || seconds < 0) return null;
    const known = shownMethods().filter(
      (m) => isKnown(data.cells[m.at][at]?.mean) && data.cells[m.at][seconds]?.mean > 0,
    );
    if (!known.length) return null;
    const named = known.length <= (isNarrow() ? 3 : 6); // more names beside points would cover each other
    const traces = known.map((m) => {
      const [cell, took] = [data.cells[m.at][at], data.cells[m.at][seconds]];
      const bar = (c) =>
        isKnown(c.low)
          ? {
              type: "data",
              symmetric: false,
              array: [c.high - c.mean],
              arrayminus: [Math.min(c.mean - c.low, c.mean)],
              thickness: 1.2,
              width: 0,
            }
          : undefined;
      return {
        name: label(m.label),
        x: [took.mean],
        y: [cell.mean],
        error_y: bar(cell),
        mode: named ? "markers+text" : "markers",
        text: [`  ${label(m.label)}`],
        textposition: "middle right",
        cliponaxis: false,
        marker: { color: ownColour(m.label), symbol: signOf(m.label), size: 11 },
        textfont: { color: inked("dim") },
        hovertemplate: `${label(m.label)}<br>%{x:.3g} s, ${number(cell.mean)} ${column.unit}<extra></extra>`,
      };
    });
    const inRows = isNarrow() && !named; // two names in a row
    $("cost-plot").style.height = inRows ? `${340 + 20 * Math.ceil(known.length / 2)}px` : "";
    const decades = known.map((m) => Math.log10(data.cells[m.at][seconds].mean));
    return {
      traces,
      layout: {
        showlegend: !named,
        ...(named ? { margin: { l: 58, r: 110, t: 14, b: 56 } } : {}),
        ...(inRows
          ? {
              margin: { l: 58, r: 16, t: 14, b: 64 + 20 * Math.ceil(known.length / 2) },
              legend: { ...legendBelow(), entrywidth: 0.5, entrywidthmode: "fraction", font: { size: 11 } },
            }
          : {}),
        xaxis: {
          type: "log",
          title: { text: "seconds a view" },
          range: [Math.min(...decades) - 0.35, Math.max(...decades) + 0.35],
          dtick: 1,
          gridcolor: inked("line"),
        },
        yaxis: { title: { text: withUnit(column) }, autorange: column.better === "lower" ? "reversed" : true },
      },
    };
  }),
);
