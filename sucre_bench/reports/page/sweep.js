// Several datasets, or one made worse step by step: which is looked at, and one score across them all.

import { $, choose, fill, h, state, summary, watch } from "./page.js";
import { ARROWS, isKnown } from "./words.js";
import { sheet } from "./sortable_table.js";
import { extent, meanCell } from "./scores.js";
import { label, ownColour, plot, signOf } from "./plots.js";

const several = summary.datasets.length > 1;
$("dataset-pick").hidden = $("sweep").hidden = !several;
$("dataset").addEventListener("change", (event) => choose({ dataset: event.currentTarget.value }));
$("sweep-metric").addEventListener("change", (event) => choose({ metric: event.currentTarget.value }));

watch(["dataset"], () =>
  fill(
    $("dataset"),
    summary.datasets.map((name) => [name, name]),
    state.dataset,
  ),
);

watch(["dataset", "metric", "hidden", "theme"], () => {
  if (!several) return;
  const columns = summary.columns.filter((c) => c.directed || c.cost);
  fill(
    $("sweep-metric"),
    columns.map((c) => [c.key, `${c.metric} (${c.variant})`]),
    state.metric,
  );
  const column = summary.columns.find((c) => c.key === state.metric);
  if (!column) return;
  const methods = summary.methods
    .map((name, at) => ({ label: name, at }))
    .filter((m) => !state.hidden.has(m.label));
  const rows = summary.datasets.map((name, at) => ({ name, cells: summary.means[state.metric][at] }));
  const scale = extent(
    rows.flatMap((row) => row.cells.flatMap((cell) => (cell ? [cell.low, cell.mean, cell.high] : []))),
  );
  sheet($("sweep-sheet"), {
    name: "datasets",
    rows,
    words: (row) => row.name,
    mark: (row) => ({ class: row.name === state.dataset ? "chosen" : null }),
    columns: [
      {
        key: "dataset",
        head: "dataset",
        better: "lower",
        value: (row) => row.name,
        cell: (row) =>
          h("button", { type: "button", class: "plain", click: () => choose({ dataset: row.name }) }, row.name),
      },
      ...methods.map((m) => ({
        key: `m${m.at}`,
        head: m.label,
        sub: [[column.metric, ARROWS[column.better], column.unit].filter(Boolean).join(" ")],
        better: column.better,
        value: (row) => row.cells[m.at]?.mean,
        cell: (row) => meanCell(row.cells[m.at], scale, column),
      })),
    ],
  });
  plot("sweep-plot", () =>
    summary.datasets.length < 3
      ? null
      : {
          traces: methods.map((m) => {
            const cells = rows.map((row) => row.cells[m.at]);
            const reach = (end) =>
              cells.map((cell) => (cell && isKnown(cell[end]) ? Math.abs(cell[end] - cell.mean) : 0));
            return {
              name: label(m.label),
              x: rows.map((row) => row.name),
              y: cells.map((cell) => (isKnown(cell?.mean) ? cell.mean : null)),
              mode: "lines+markers",
              line: { color: ownColour(m.label), width: 1.6 },
              marker: { color: ownColour(m.label), symbol: signOf(m.label), size: 8 },
              error_y: {
                type: "data",
                symmetric: false,
                array: reach("high"),
                arrayminus: reach("low"),
                thickness: 1,
                width: 3,
              },
            };
          }),
          layout: {
            xaxis: { type: "category", title: { text: "" } },
            yaxis: { title: { text: [column.metric, ARROWS[column.better], column.unit].filter(Boolean).join(" ") } },
          },
        },
  );
});
