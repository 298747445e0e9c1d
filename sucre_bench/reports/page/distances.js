// Charts against distance.

import { $, columnOf, fill, roleOf, shownMethods, watch } from "./page.js";
import { css, isKnown, withUnit } from "./words.js";
import { chartsOf, colourOf, distanceOf, measuresOf } from "./charts.js";
import { axis, inked, isNarrow, label, legendHeight, ownColour, plot, signOf } from "./plots.js";

watch(["dataset"], () => {
  const measures = measuresOf("chart");
  fill(
    $("distance-score"),
    measures.map((c) => [c.key, withUnit(c)]),
    measures[0]?.key ?? "",
  );
  const hues = [
    ...new Set(chartsOf().flatMap(({ chart }) => Object.values(chart.patches).flatMap((p) => Object.keys(p)))),
  ].filter((key) => roleOf(key) === "patch-hue" && !key.endsWith("-expected"));
  const groups = chartsBySharedPatches();
  $("hue-kind").parentElement.hidden = groups.length < 2;
  fill(
    $("hue-kind"),
    groups.map(([patches, names]) => [patches, names.join(", ")]),
    groups[0]?.[0] ?? "",
  );
  fill(
    $("hue-score"),
    hues.map((key) => [key, key.split(":")[1]]),
    hues[0] ?? "",
  );
});
// The charts that have the same patches, which panels show together: patches and names of the charts.
function chartsBySharedPatches() {
  const found = new Map();
  for (const { name, chart } of chartsOf()) {
    const patches = Object.keys(chart.patches).join("\n");
    found.set(patches, [...new Set([...(found.get(patches) || []), name])]);
  }
  return [...found].filter(([patches]) => patches);
}

for (const id of ["distance-score", "hue-score", "hue-kind"]) $(id).addEventListener("change", () => drawDistances());
watch(["dataset", "hidden", "theme"], drawDistances);

function drawDistances() {
  if (!chartsOf().length) return;
  const charts = chartsOf()
    .filter((c) => distanceOf(c) !== null)
    .sort((a, b) => distanceOf(a) - distanceOf(b));
  $("distance-part").hidden = $("hue-part").hidden = false;
  plot("distance-plot", () => {
    const column = columnOf($("distance-score").value);
    if (!column || !charts.length) return null;
    const traces = shownMethods().map((m) => {
      const known = charts.filter((c) => isKnown(c.chart.scores[column.key]?.[m.at]));
      return {
        name: label(m.label),
        x: known.map(distanceOf),
        y: known.map((c) => c.chart.scores[column.key][m.at]),
        mode: "lines+markers",
        line: { color: ownColour(m.label), width: 1.2 },
        opacity: 0.9,
        marker: { color: ownColour(m.label), symbol: signOf(m.label), size: 8 },
        text: known.map((c) => `${label(c.view.name)} · ${label(c.name)}`),
        hovertemplate: `${label(m.label)}<br>%{text}<br>%{x:.2f} m, %{y:.3g} ${column.unit}<extra></extra>`,
      };
    });
    return {
      traces,
      layout: {
        xaxis: { title: { text: "distance of the chart, m" } },
        yaxis: { title: { text: withUnit(column) }, rangemode: "tozero" },
      },
    };
  });
  plot("hue-plot", () =>
    huePlot(
      charts.filter(({ chart }) => Object.keys(chart.patches).join("\n") === $("hue-kind").value),
      $("hue-score").value,
    ),
  );
}

// Small multiples, a patch each; hues are unwrapped about the one expected.
function huePlot(charts, key) {
  const names = [
    ...new Set(
      charts.flatMap(({ chart }) =>
        Object.entries(chart.patches)
          .filter(([, p]) => key in p)
          .map(([name]) => name),
      ),
    ),
  ].sort((a, b) => parseInt(a, 10) - parseInt(b, 10));
  if (!key || !names.length) return null;
  const across = isNarrow() ? 2 : 4;
  const down = Math.ceil(names.length / across);
  const bottom = 56 + legendHeight(shownMethods().map((m) => m.label));
  const layout = {
    height: 26 + bottom + 140 * down,
    annotations: [],
    shapes: [],
    margin: { l: 46, r: 12, t: 26, b: bottom },
  };
  const traces = [];
  names.forEach((patch, n) => {
    const [x, y] = [`x${n ? n + 1 : ""}`, `y${n ? n + 1 : ""}`];
    const [column, row] = [n % across, Math.floor(n / across)];
    const [gapX, gapY] = [isNarrow() ? 0.16 : 0.06, 0.26 / down];
    const [width, height] = [(1 - gapX * (across - 1)) / across, (1 - gapY * (down - 1)) / down];
    const left = column * (width + gapX);
    const top = 1 - row * (height + gapY);
    layout[`xaxis${n ? n + 1 : ""}`] = {
      ...axis(),
      domain: [left, left + width],
      anchor: y,
      matches: n ? "x" : undefined,
      showticklabels: row === down - 1 || n + across >= names.length,
      automargin: false,
    };
    layout[`yaxis${n ? n + 1 : ""}`] = {
      ...axis(),
      domain: [Math.max(0, top - height), top],
      anchor: x,
      nticks: 5,
      automargin: false,
    };
    const own = charts.filter(({ chart }) => chart.patches[patch]?.[`${key}-expected`]);
    const expected = own.map(({ chart }) => chart.patches[patch][`${key}-expected`].find(isKnown)).find(isKnown);
    const colour = own.map(({ chart }) => colourOf(chart.patches[patch], "-expected")).find(Boolean);
    layout.annotations.push({
      text: `${colour ? `<span style="color:${css(colour)}">■</span> ` : ""}${label(patch.replace(/^\d+-/, "").replaceAll("-", " "))}`,
      x: left,
      y: top,
      xref: "paper",
      yref: "paper",
      xanchor: "left",
      yanchor: "bottom",
      showarrow: false,
      font: { size: 11.5 },
    });
    if (expected !== undefined)
      layout.shapes.push({
        type: "line",
        xref: `${x} domain`,
        yref: y,
        x0: 0,
        x1: 1,
        y0: expected,
        y1: expected,
        line: { color: inked("ink"), width: 1, dash: "dot" },
      });
    for (const m of shownMethods()) {
      const known = charts.filter(({ chart }) => isKnown(chart.patches[patch]?.[key]?.[m.at]));
      const turned = (hue) => (expected === undefined ? hue : expected + ((hue - expected + 540) % 360) - 180);
      traces.push({
        name: label(m.label),
        legendgroup: m.label,
        showlegend: n === 0,
        xaxis: x,
        yaxis: y,
        x: known.map(distanceOf),
        y: known.map(({ chart }) => turned(chart.patches[patch][key][m.at])),
        mode: "lines+markers",
        line: { color: ownColour(m.label), width: 1.1 },
        marker: { color: ownColour(m.label), symbol: signOf(m.label), size: 5 },
        hovertemplate: `${label(m.label)}<br>%{x:.2f} m, %{y:.0f}°<extra></extra>`,
      });
    }
  });
  return { traces, layout };
}
