// Which view to look at: the best, median and worst of a method, and those on which it loses most.

import { $, VIEW, choose, columnOf, data, h, photograph, state, viewsByScore, watch } from "./page.js";
import { number, pictureName, titled } from "./words.js";

const MOST_LOSSES = 6;

const places = { best: 0, median: 0.5, worst: 1 };
const placed = (ranked, name) => ranked[Math.min(ranked.length - 1, Math.floor(places[name] * ranked.length))];

watch(["dataset", "method", "metric", "view"], () => {
  const ranked = viewsByScore(state.method, state.metric);
  const column = columnOf(state.metric);
  $("ranked-views").hidden = !ranked.length || !column?.ranked;
  for (const button of document.querySelectorAll("[data-place]")) {
    const [view, score] = placed(ranked, button.dataset.place) || [{ name: "" }, null];
    button.disabled = !view.name;
    button.title = view.name ? `${view.name}: ${titled(column)} ${number(score)} ${column.unit}` : "";
    button.setAttribute("aria-pressed", String(view.name !== "" && view.name === state.view));
  }
});
for (const button of document.querySelectorAll("[data-place]"))
  button.addEventListener("click", () => {
    const [view] = placed(viewsByScore(state.method, state.metric), button.dataset.place);
    choose({ view: view.name });
  });

// The method to whose score a picture belongs: the photograph's where a method returns that.
const methodOf = (which) => (which === VIEW ? photograph()[0] : which);

// The views of both methods with what the right one loses to the left one there, the largest loss first.
export function losses() {
  const column = columnOf(state.metric);
  if (!column?.ranked) return [];
  const sign = column.better === "lower" ? 1 : -1;
  const other = new Map(viewsByScore(methodOf(state.before), state.metric).map(([view, score]) => [view, score]));
  return viewsByScore(methodOf(state.method), state.metric)
    .filter(([view]) => other.has(view))
    .map(([view, score]) => [view, sign * (score - other.get(view))])
    .sort((a, b) => b[1] - a[1]);
}

watch(["dataset", "method", "before", "metric", "view"], () => {
  const found = state.method === state.before ? [] : losses();
  $("losses").hidden = found.length < 2;
  if (found.length < 2) return;
  const column = columnOf(state.metric);
  const lost = found.filter(([, loss]) => loss > 0);
  $("losses-title").textContent = lost.length
    ? `Largest loss of ${pictureName(state.method)} against ${pictureName(state.before)}`
    : `${pictureName(state.method)} loses on no view against ${pictureName(state.before)}; its smallest gains`;
  const line = ([view, loss]) =>
    h(
      "li",
      {},
      h(
        "button",
        { type: "button", class: "plain", "aria-current": String(view.name === state.view), click: () => choose({ view: view.name }) },
        h("span", {}, view.name),
        h("b", {}, `${loss > 0 ? "−" : "+"}${number(Math.abs(loss))} ${column.unit}`.trim()),
      ),
    );
  $("losses-list").replaceChildren(...(lost.length ? lost : found).slice(0, MOST_LOSSES).map(line));
  $("losses-note").textContent =
    `${titled(column)}, better on ${found.length - lost.length} of ${found.length} views`;
});
