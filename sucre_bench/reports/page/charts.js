// Colour charts: each patch as measured and as expected, in every method's picture.

import { $, columnOf, data, fill, h, roleOf, shownMethods, state, summary, watch } from "./page.js";
import { css, dot, isKnown, number, withUnit } from "./words.js";
import { sheet } from "./sortable_table.js";

export const chartsOf = () =>
  data.views.flatMap((view) =>
    Object.entries(view.charts).map(([name, chart]) => ({ view, name, chart, key: `${view.name}\n${name}` })),
  );
export const distanceOf = ({ chart }) => {
  const known = Object.entries(chart.scores)
    .filter(([key]) => roleOf(key) === "chart-distance")
    .flatMap(([, values]) => values)
    .filter(isKnown);
  return known.length ? known[0] : null; // of the view: the same for every method
};
export const measuresOf = (kind) =>
  data.columns.filter(
    (c) =>
      c.of === "chart" &&
      c.directed &&
      chartsOf().some(({ chart }) =>
        kind === "chart" ? c.key in chart.scores : Object.values(chart.patches).some((p) => c.key in p),
      ),
  );

// The metrics that have a role.
const withRole = (role) => Object.keys(summary.roles).filter((metric) => summary.roles[metric] === role);

watch(["dataset"], () => {
  const charts = chartsOf();
  const has = charts.length > 0;
  $("charts").hidden = !has;
  if (!has) return;
  const measures = measuresOf("patch");
  fill(
    $("patch-score"),
    measures.map((c) => [c.key, withUnit(c)]),
    (measures.find((c) => roleOf(c.key) === "colour-difference") || measures[0] || { key: "" }).key,
  );
  fill(
    $("chart"),
    charts.map((c) => [
      c.key,
      [c.view.name, c.name, distanceOf(c) && `${number(distanceOf(c))} m`].filter(Boolean).join(" · "),
    ]),
    charts[0].key,
  );
});

// The chart follows the view, where that has one.
watch(["dataset", "view"], () => {
  const charts = chartsOf();
  const own = charts.find((c) => c.view.name === state.view);
  if (own && !$("chart").value.startsWith(`${state.view}\n`)) $("chart").value = own.key;
  drawSwatches();
});
watch(["hidden"], drawSwatches);
$("chart").addEventListener("change", drawSwatches);
$("patch-score").addEventListener("change", drawSwatches);

function drawSwatches() {
  const one = chartsOf().find((c) => c.key === $("chart").value);
  if (!one) return;
  const key = $("patch-score").value;
  const patches = Object.entries(one.chart.patches).sort(([a], [b]) => parseInt(a, 10) - parseInt(b, 10));
  const column = columnOf(key);
  const expected = patches.map(([, scores]) => colourOf(scores, "-expected"));
  const hasColours = expected.some(Boolean);
  const head = h(
    "tr",
    {},
    h("th", { scope: "col" }, "method"),
    h("th", { scope: "col", class: "mean" }, column ? column.metric : ""),
    patches.map(([name]) =>
      h("th", { scope: "col", class: "patch" }, h("span", {}, name.replace(/^\d+-/, "").replaceAll("-", " "))),
    ),
  );
  const wanted = h(
    "tr",
    {},
    h("th", { scope: "row" }, "expected"),
    h("td", {}),
    expected.map((colour) => h("td", {}, swatch(colour, null))),
  );
  const rows = shownMethods().map((m) =>
    h(
      "tr",
      {},
      h("th", { scope: "row" }, dot(m.label), m.label),
      h("td", { class: "mean" }, number(one.chart.scores[key]?.[m.at])),
      patches.map(([name, scores], at) => {
        const value = scores[key]?.[m.at];
        const measured = colourOf(scores, "", m.at);
        return h(
          "td",
          {
            title: `${m.label}, ${name}: ${number(value)} ${column?.unit ?? ""}; measured ${rgbText(measured)}, expected ${rgbText(expected[at])}`,
          },
          hasColours ? swatch(measured, expected[at]) : "",
          h("small", {}, value === undefined || value === null ? "" : number(value)),
        );
      }),
    ),
  );
  $("swatches").replaceChildren(
    h("table", { class: "swatches" }, h("thead", {}, head), h("tbody", {}, hasColours ? wanted : "", rows)),
  );
  $("swatches-note").textContent = hasColours
    ? `Each square shows the measured colour, and the disc in it the expected colour. The number below is their difference${column ? `, ${withUnit(column)}` : ""}.`
    : `The colours of the patches were not scored: add ${withRole("patch-colour").join(" or ")} to metrics=[...] to see them.`;
}

// A patch's colour as it was measured in a method's picture, or as it should be.
export function colourOf(scores, what, at = null) {
  const [metric] = withRole("patch-colour");
  const rgb = ["red", "green", "blue"].map((channel) => scores[`${metric}:${channel}${what}`]);
  const values = rgb.map((own) => own && (at === null ? own.find(isKnown) : own[at]));
  return values.every(isKnown) ? values : null;
}

const rgbText = (rgb) => (rgb ? rgb.map((x) => Math.round(255 * x)).join(", ") : "nothing");

function swatch(outer, inner) {
  if (!outer) return h("span", { class: "swatch hole" });
  return h(
    "span",
    { class: "swatch", style: `background:${css(outer)}` },
    inner ? h("i", { style: `background:${css(inner)}` }) : "",
  );
}

// -- every chart in numbers -----------------------------------------------------------------------------------

watch(["dataset", "metric", "hidden"], () => {
  const measures = measuresOf("chart");
  const column = measures.find((c) => c.key === state.metric) || measures[0];
  if (!column) return;
  sheet($("charts-sheet"), {
    name: "charts",
    rows: chartsOf(),
    words: (row) => row.view.name,
    columns: [
      {
        key: "chart",
        head: "chart",
        better: "lower",
        value: (row) => row.key,
        cell: (row) => `${row.view.name} · ${row.name}`,
      },
      {
        key: "distance",
        head: "distance (m)",
        better: "lower",
        value: distanceOf,
        cell: (row) => h("td", {}, number(distanceOf(row))),
      },
      ...shownMethods().map((m) => ({
        key: `m${m.at}`,
        head: m.label,
        sub: [withUnit(column)],
        better: column.better,
        value: (row) => row.chart.scores[column.key]?.[m.at],
        cell: (row) => h("td", {}, number(row.chart.scores[column.key]?.[m.at])),
      })),
    ],
  });
});
