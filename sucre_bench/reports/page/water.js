// The water as each method estimates it, beside the true one where that is known.

import { $, data, fill, h, state, watch } from "./page.js";
import { css, isKnown, number } from "./words.js";
import { sheet } from "./sortable_table.js";
import { axis, isNarrow, plot } from "./plots.js";

const PARAMETERS = [
  ["B", "B, veiling light", ""],
  ["beta", "β, attenuation", "1/m"],
  ["gamma", "γ, backscatter", "1/m"],
];
const CHANNELS = [
  ["red", "#d1495b"],
  ["green", "#3a9d5d"],
  ["blue", "#3d7dd8"],
];
const SYMBOLS = { B: "B", beta: "β", gamma: "γ" };

const withWater = () =>
  data.methods.map((m, at) => ({ ...m, at })).filter((m) => data.views.some((v) => v.results[m.at].water));
const triple = (values) => (Array.isArray(values) ? values.map(number).join("  ") : "–");

export function waterLine(water) {
  const light =
    Array.isArray(water.B) && water.B.every(isKnown)
      ? h("span", {
          class: "swatch small",
          style: `background:${css(water.B.map((x) => Math.min(1, Math.max(0, x))))}`,
          title: "the veiling light",
        })
      : "";
  return h(
    "dl",
    { class: "scores water" },
    PARAMETERS.filter(([key]) => water[key]?.some(isKnown)).map(([key]) =>
      h("div", {}, h("dt", {}, SYMBOLS[key], key === "B" ? light : ""), h("dd", {}, triple(water[key]))),
    ),
  );
}

watch(["dataset"], () => {
  const methods = withWater();
  $("water").hidden = !methods.length;
  if (methods.length)
    fill(
      $("water-method"),
      methods.map((m) => [m.label, m.label]),
      (methods.find((m) => m.label === state.method) || methods[0]).label,
    );
});
watch(["method"], () => {
  if (withWater().some((m) => m.label === state.method)) $("water-method").value = state.method;
});
$("water-method").addEventListener("change", drawWater);
watch(["dataset", "method", "theme"], drawWater);

function drawWater() {
  const method = withWater().find((m) => m.label === $("water-method").value);
  if (!method) return;
  plot("water-plot", () => waterPlot(method));
  drawWaters();
}

// A panel a parameter, a line a channel over the views; the truth dotted.
function waterPlot(method) {
  const layout = {
    height: 300,
    grid: { rows: 1, columns: 3, pattern: "independent", xgap: 0.12 },
    annotations: [],
    shapes: [],
    margin: { l: 46, r: 12, t: 30, b: 84 },
  };
  if (isNarrow())
    Object.assign(layout, { height: 760, grid: { rows: 3, columns: 1, pattern: "independent", ygap: 0.25 } });
  const names = data.views.map((v) => v.name);
  const traces = [];
  PARAMETERS.forEach(([key, title, unit], n) => {
    const [x, y] = [`x${n ? n + 1 : ""}`, `y${n ? n + 1 : ""}`];
    layout[`xaxis${n ? n + 1 : ""}`] = {
      ...axis(),
      type: "category",
      showticklabels: false, // long names, told when one points at a line
      title: { text: "views in order", standoff: 6 },
    };
    layout[`yaxis${n ? n + 1 : ""}`] = { ...axis(), rangemode: "tozero" };
    layout.annotations.push({
      text: unit ? `${title}, ${unit}` : title,
      x: 0,
      y: 1,
      xref: `${x} domain`,
      yref: `${y} domain`,
      xanchor: "left",
      yanchor: "bottom",
      yshift: 4,
      showarrow: false,
    });
    CHANNELS.forEach(([channel, colour], c) => {
      const waters = data.views.map((v) => v.results[method.at].water);
      const errors = waters.map((w) => w?.standard_error?.[key]?.[c]);
      traces.push({
        name: channel,
        legendgroup: channel,
        showlegend: n === 0,
        x: names,
        y: waters.map((w) => w?.[key]?.[c] ?? null),
        xaxis: x,
        yaxis: y,
        mode: "lines+markers",
        line: { color: colour, width: 1.4 },
        marker: { size: 7 },
        error_y: errors.some(isKnown)
          ? { type: "data", array: errors.map((e) => e ?? 0), thickness: 1, width: 2 }
          : undefined,
        hovertemplate: `%{x}<br>${channel} %{y:.3g} ${unit}<extra></extra>`,
      });
      const truth = data.views.map((v) => v.truth?.[key]?.[c] ?? null);
      if (truth.some(isKnown))
        traces.push({
          name: "true",
          legendgroup: "true",
          showlegend: n === 0 && c === 0,
          x: names,
          y: truth,
          xaxis: x,
          yaxis: y,
          mode: "lines",
          line: { color: colour, width: 1.6, dash: "dot" },
          hovertemplate: `true ${channel} %{y:.3g} ${unit}<extra></extra>`,
        });
    });
  });
  return { traces, layout };
}

// The same in numbers, of every method.
function drawWaters() {
  const rows = data.views.flatMap((view) => [
    ...(view.truth ? [{ view, label: "true", water: view.truth }] : []),
    ...withWater()
      .filter((m) => view.results[m.at].water)
      .map((m) => ({ view, label: m.label, water: view.results[m.at].water })),
  ]);
  sheet($("water-sheet"), {
    name: "waters",
    rows,
    most: 24,
    mark: (row) => ({ class: row.label === "true" ? "truth" : null }),
    columns: [
      { key: "view", head: "view", better: "lower", value: (row) => row.view.name, cell: (row) => row.view.name },
      {
        key: "method",
        head: "method",
        text: true,
        better: "lower",
        value: (row) => row.label,
        cell: (row) => h("td", { class: "text" }, row.label),
      },
      ...PARAMETERS.flatMap(([key, , unit]) =>
        CHANNELS.map(([channel], c) => ({
          key: `${key}-${channel}`,
          head: `${SYMBOLS[key]} ${channel}`,
          sub: [unit],
          better: "lower",
          value: (row) => row.water[key]?.[c],
          cell: (row) => h("td", {}, number(row.water[key]?.[c])),
        })),
      ),
      {
        key: "encoding",
        head: "of",
        text: true,
        better: "lower",
        value: (row) => row.water.encoding || "",
        cell: (row) => h("td", { class: "text dim" }, row.water.encoding ? `${row.water.encoding} intensities` : ""),
      },
    ],
  });
}
