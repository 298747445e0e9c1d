// Numbers and commands as people read them.

import { $, REFERENCE, VIEW, data, h, summary } from "./page.js";

export const HUGE = 1e307;
export const ARROWS = { higher: "↑", lower: "↓", none: "" };

// The text of a number. The rule is that of the tables of the command line, which the page's data have: the decimals
// from a size on, and the figures of smaller numbers.
export function number(value) {
  if (value === null || value === undefined) return "–";
  const size = Math.abs(value);
  if (size >= HUGE) return value > 0 ? "∞" : "−∞";
  if (!size) return "0";
  const { decimals, figures, scientific_below } = summary.numbers;
  const rule = decimals.find(([least]) => size >= least);
  const text = rule
    ? value.toFixed(rule[1])
    : Number(size.toPrecision(figures)) < scientific_below
      ? value.toExponential(figures - 1)
      : value.toPrecision(figures);
  return text.replace(/e-(\d)$/, "e-0$1").replaceAll("-", "−");
}

export const isKnown = (value) => value !== null && value !== undefined && Math.abs(value) < HUGE;
export const percent = (share) => `${share > 0.999 && share < 1 ? "99.9" : Math.round(share * 100)} %`;

// A score's name, with its variant where a metric has several here.
export function titled(column) {
  const several = data.columns.filter((c) => c.metric === column.metric).length > 1;
  return several ? `${column.metric} (${column.variant})` : column.metric;
}

export const withUnit = (column) => [titled(column), ARROWS[column.better], column.unit].filter(Boolean).join(" ");

export function pictureName(which) {
  if (which === VIEW) return "the photograph";
  if (which === REFERENCE) return "reference, without water";
  return data.photographs?.includes(which) ? `${which}, the photograph` : which;
}

// A method's colour before its name.
export const dot = (method) => h("i", { class: "dot", style: `--own:var(--m${summary.methods.indexOf(method)})` });

// The command that makes a restoration again, or all of a method's, with one score or all of them.
export function commandFor(method, view, metric = "") {
  if (!method.command) return "";
  return [method.command, view ? view.words : method.views, data.metric_words[metric]].filter(Boolean).join(" ");
}

export function commandBox(command) {
  if (!command)
    return h(
      "p",
      { class: "note" },
      "An older version wrote these rows, without the dataset's options: their command is not known.",
    );
  return h(
    "div",
    { class: "command" },
    h("code", {}, command),
    h(
      "button",
      { type: "button", "aria-label": "copy the command", click: (event) => copy(command, event.currentTarget) },
      "Copy",
    ),
  );
}

// Pages opened from disk may not use the clipboard everywhere: then the old way.
export async function copy(text, button) {
  try {
    await navigator.clipboard.writeText(text);
  } catch {
    const area = h("textarea", { class: "unseen" });
    area.value = text;
    document.body.append(area);
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  const before = button.textContent;
  button.textContent = "Copied";
  $("announcement").textContent = "copied";
  setTimeout(() => {
    button.textContent = before;
  }, 1200);
}

// A colour of the style sheet, of intensities from 0 to 1.
export const css = (rgb) => `rgb(${rgb.map((x) => Math.round(255 * x)).join(" ")})`;

// A value of a record in one line.
export function briefly(value) {
  if (Number.isInteger(value)) return String(value).replace("-", "−");
  if (typeof value === "number") return number(value);
  if (Array.isArray(value)) return value.map(briefly).join(", ") || "none";
  if (value && typeof value === "object")
    return Object.entries(value)
      .map(([name, inner]) => `${name}: ${briefly(inner)}`)
      .join("; ");
  return value === null ? "–" : String(value);
}
