// The table of scores: the methods' means with intervals and ties, or every view.

import { $, choose, columnOf, data, h, shownMethods, state, summary, watch } from "./page.js";
import { ARROWS, HUGE, dot, isKnown, number, percent, titled, withUnit } from "./words.js";
import { orderOf, setOrder, sheet } from "./sortable_table.js";

watch(["dataset", "hidden", "unshown"], () => {
  menu(
    "methods",
    data.methods.map((m) => [m.label, m.label]),
    state.hidden,
    (hidden) => choose({ hidden }),
  );
  menu(
    "metrics",
    data.columns.map((c) => [c.key, `${c.metric} (${c.variant})`]),
    state.unshown,
    (unshown) => choose({ unshown }),
  );
});

// Boxes to tick; those that are not are kept.
function menu(name, options, off, changed) {
  const on = options.filter(([value]) => !off.has(value)).length;
  $(`${name}-count`).textContent = on < options.length ? `${on} of ${options.length}` : `${on}`;
  const tick = ([value, text]) =>
    h(
      "label",
      {},
      h("input", {
        type: "checkbox",
        value,
        checked: !off.has(value),
        change: (event) => {
          const next = new Set(off);
          if (event.currentTarget.checked) next.delete(value);
          else next.add(value);
          changed(next);
          [...$(`${name}-menu`).querySelectorAll("input")].find((box) => box.value === value).focus();
        },
      }),
      h("span", {}, text),
    );
  const all = h(
    "button",
    { type: "button", click: () => changed(new Set(on ? options.map(([value]) => value) : [])) },
    on ? "None" : "All",
  );
  $(`${name}-menu`).replaceChildren(...options.map(tick), all);
}

watch(["dataset", "rows", "filter", "hidden", "unshown", "metric", "method", "view", "sort"], drawScores);

function drawScores() {
  for (const button of document.querySelectorAll("[data-rows]"))
    button.setAttribute("aria-pressed", String(button.dataset.rows === state.rows));
  const columns = data.columns.map((c, at) => ({ ...c, at })).filter((c) => !state.unshown.has(c.key));
  if (state.rows === "mean") drawMeans(columns);
  else drawEveryView(columns);
  $("scores-note").textContent =
    state.rows === "mean"
      ? [data.few, data.legend, ...data.notes].filter(Boolean).join(". ") + "."
      : "A score of charts is the mean over the view's charts. Where a masked score does not cover the whole, its coverage stands below it. Common pixels are those that all methods fill.";
}

function heading(c, value, cell) {
  const n = `${c.n} ${c.of}${c.n === 1 ? "" : "s"}`;
  return {
    key: c.key,
    head: [c.metric, ARROWS[c.better], c.unit && `(${c.unit})`].filter(Boolean).join(" "),
    sub: [c.variant, state.rows === "mean" ? n : "", c.pixels === "common" ? "common pixels" : ""],
    better: c.better,
    chosen: c.key === state.metric,
    value,
    cell,
  };
}

// The order in which the table opens: the main score, the best method first.
const bestFirst = () => (data.main ? `${columnOf(data.main).better === "higher" ? "-" : ""}${data.main}` : "");

function drawMeans(columns) {
  setOrder("scores", data.columns.some((c) => c.key === state.sort.replace("-", "")) || state.sort.endsWith("method") ? state.sort : bestFirst());
  const isPhotograph = (row) => data.photographs.includes(row.label);
  const rows = shownMethods();
  const method = {
    key: "method",
    head: "method",
    better: "lower",
    value: (row) => row.label,
    cell: (row) =>
      h(
        "button",
        { type: "button", class: "plain", title: "show its pictures", click: () => choose({ method: row.label }) },
        dot(row.label),
        row.label,
      ),
  };
  const scores = columns.map((c) => {
    const cells = rows.map((row) => data.cells[row.at][c.at]);
    const scale = extent(cells.flatMap((cell) => (cell ? [cell.low, cell.mean, cell.high] : [])));
    return heading(
      c,
      (row) => data.cells[row.at][c.at]?.mean,
      (row) => meanCell(data.cells[row.at][c.at], scale, c),
    );
  });
  sheet($("scores-sheet"), {
    name: "scores",
    columns: [method, ...scores],
    rows,
    filter: state.filter,
    words: (row) => row.label,
    last: isPhotograph,
    mark: (row) => ({ class: row.label === state.method ? "chosen" : isPhotograph(row) ? "dim" : null }),
    onSort: (column) => choose({ sort: orderOf("scores"), ...(column.key === "method" ? {} : { metric: column.key }) }),
  });
}

export function meanCell(cell, scale, column) {
  if (!cell) return h("td", { class: "hole", title: "no score" }, "–");
  const few = column.views < summary.fewest_views; // which make it rough: it is in the title only
  const tie = cell.tie;
  const hasInterval = isKnown(cell.low) && cell.high > cell.low && cell.high < HUGE;
  const title = [
    `${withUnit(column)}: ${number(cell.mean)}${isKnown(cell.std) ? ` ± ${number(cell.std)}` : ""}`,
    hasInterval && `95 % interval ${number(cell.low)} to ${number(cell.high)}`,
    tie && "the difference from the best may be chance",
    cell.holes && `lacks ${cell.holes} that others have`,
  ]
    .filter(Boolean)
    .join("; ");
  return h(
    "td",
    { class: cell.look || null, title },
    h("span", { class: "mark", "aria-label": tie ? "ties with the best" : null }, tie ? "≈" : ""),
    h("span", { class: "mean" }, number(cell.mean)),
    cell.holes ? h("span", { class: "holes" }, ` ○${cell.holes}`) : "",
    hasInterval && !few ? h("small", {}, `${number(cell.low)} to ${number(cell.high)}`) : "",
    hasInterval && !few && scale ? whisker(cell, scale) : "",
  );
}

// Mean and interval, drawn on the column's own scale.
function whisker(cell, [low, high]) {
  const at = (value) => `${(100 * (value - low)) / (high - low)}%`;
  return h("span", {
    class: "whisker",
    "aria-hidden": "true",
    style: `--from:${at(cell.low)};--to:${at(cell.high)};--at:${at(cell.mean)}`,
  });
}

export function extent(values) {
  const known = values.filter(isKnown);
  const [low, high] = [Math.min(...known), Math.max(...known)];
  return high > low ? [low, high] : null;
}

function drawEveryView(columns) {
  const rows = data.views.flatMap((view) =>
    shownMethods().map((m) => ({ view, method: m, result: view.results[m.at] })),
  );
  const pick = (row) => () => choose({ view: row.view.name, method: row.method.label });
  const names = [
    {
      key: "view",
      head: "view",
      better: "lower",
      value: (row) => row.view.name,
      cell: (row) =>
        h("button", { type: "button", class: "plain", title: "show its pictures", click: pick(row) }, row.view.name),
    },
    {
      key: "method",
      head: "method",
      text: true,
      better: "lower",
      value: (row) => row.method.label,
      cell: (row) => h("td", { class: "text" }, dot(row.method.label), row.method.label),
    },
  ];
  const scores = columns.map((c) =>
    heading(
      c,
      (row) => row.result.scores?.[c.key],
      (row) => {
        if (row.result.status !== "ok")
          return h("td", { class: "hole", title: `${row.result.status}: ${row.result.reason}` }, row.result.status);
        const [value, covered] = [row.result.scores[c.key], row.result.covers[c.key]];
        return h(
          "td",
          { class: value === undefined || value === null ? "hole" : null },
          number(value),
          covered === undefined ? "" : h("small", {}, `of ${percent(covered)}`),
        );
      },
    ),
  );
  sheet($("scores-sheet"), {
    name: "every view",
    columns: [...names, ...scores],
    rows,
    filter: state.filter,
    words: (row) =>
      `${row.view.name} ${row.method.label} ${row.result.status === "ok" ? "" : row.result.status} ${row.result.reason || ""}`,
    mark: (row) => ({ class: row.view.name === state.view && row.method.label === state.method ? "chosen" : null }),
    onSort: (column) => columnOf(column.key) && choose({ metric: column.key }),
  });
}

for (const button of document.querySelectorAll("[data-rows]"))
  button.addEventListener("click", () => choose({ rows: button.dataset.rows }));
$("filter").addEventListener("input", (event) => choose({ filter: event.currentTarget.value }));
