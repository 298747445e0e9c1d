// A table to sort and filter.

import { h } from "./page.js";

const MOST_ROWS = 200;
const sorted = new Map();

// The order of a table as text: a column's key, "-" before it for the greatest first; "" as the rows come.
export const orderOf = (name) => (sorted.has(name) ? `${sorted.get(name).down ? "-" : ""}${sorted.get(name).key}` : "");
export function setOrder(name, order) {
  if (order) sorted.set(name, { key: order.replace(/^-/, ""), down: order.startsWith("-") });
  else sorted.delete(name);
}

// columns: {key, head, sub, better, value(row), cell(row), chosen}; rows: anything; words(row): what a filter looks in;
// last(row): whether it stays below the others.
export function sheet(
  place,
  { name, columns, rows, words = () => "", filter = "", last = () => false, mark = () => ({}), onSort = () => {}, most = MOST_ROWS },
) {
  const order = sorted.get(name);
  const wanted = filter.toLowerCase().split(/\s+/).filter(Boolean);
  const kept = rows.filter((row) => wanted.every((word) => words(row).toLowerCase().includes(word)));
  const by = order && columns.find((c) => c.key === order.key);
  if (by) kept.sort((a, b) => last(a) - last(b) || compared(by.value(a), by.value(b), order.down));
  const redraw = (more = {}) => sheet(place, { name, columns, rows, words, filter, last, mark, onSort, most, ...more });

  const head = columns.map((column) => {
    const down = order && order.key === column.key ? order.down : null;
    const sort = () => {
      const next = down === null ? column.better === "higher" : !down;
      sorted.set(name, { key: column.key, down: next });
      redraw();
      place.querySelector(`[data-key="${CSS.escape(column.key)}"] button`).focus();
      onSort(column);
    };
    return h(
      "th",
      {
        scope: "col",
        "data-key": column.key,
        class: [column.chosen && "chosen", column.text && "text"].filter(Boolean).join(" "),
        "aria-sort": down === null ? "none" : down ? "descending" : "ascending",
      },
      h(
        "button",
        { type: "button", click: sort },
        h("span", {}, column.head),
        h("i", { "aria-hidden": "true" }, down === null ? "" : down ? "▾" : "▴"),
      ),
      ...(column.sub || []).map((line) => h("small", {}, line)),
    );
  });
  const body = kept.slice(0, most).map((row) =>
    h(
      "tr",
      mark(row),
      columns.map((column, at) => {
        const cell = column.cell(row);
        return cell instanceof HTMLTableCellElement ? cell : h(at ? "td" : "th", at ? {} : { scope: "row" }, cell);
      }),
    ),
  );
  const left = place.querySelector(".scroll")?.scrollLeft || 0;
  place.replaceChildren(
    h(
      "div",
      { class: "scroll", tabindex: "0", role: "region", "aria-label": name },
      h("table", { class: "sheet" }, h("thead", {}, h("tr", {}, head)), h("tbody", {}, body)),
    ),
    kept.length ? "" : h("p", { class: "note" }, "Nothing matches the filter."),
    kept.length > most
      ? h("button", { type: "button", click: () => redraw({ most: most + 1000 }) }, `${kept.length - most} more rows`)
      : "",
  );
  place.querySelector(".scroll").scrollLeft = left;
}

// Holes are last, whichever way.
function compared(a, b, down) {
  const none = [a, b].map((x) => x === null || x === undefined);
  if (none[0] || none[1]) return none[0] - none[1];
  const order = typeof a === "string" ? a.localeCompare(b, undefined, { numeric: true }) : a - b;
  return down ? -order : order;
}
