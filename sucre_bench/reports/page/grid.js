// All methods on this view.

import { $, REFERENCE, VIEW, choose, columnOf, data, h, shownMethods, state, summary, viewOf, watch } from "./page.js";
import { dot, number, pictureName, titled } from "./words.js";
import { isNear } from "./zoom.js";
import { frameOf, picturesOf, sharpen } from "./pictures.js";

watch(["dataset", "view", "hidden", "layer", "guesses"], () => {
  const view = viewOf(state.view);
  if (!view) return;
  const shown = new Set(shownMethods().map((m) => m.label));
  const pictures = picturesOf(view).filter((which) => [VIEW, REFERENCE].includes(which) || shown.has(which));
  $("grid").replaceChildren(...pictures.map((which) => tile(view, which)));
  const missing = data.views.filter((v) => v.original && !v.original.id).length;
  $("pictures-note").textContent = missing
    ? `This page contains the pictures of ${data.views.length - missing} of ${data.views.length} views, evenly spread. It reads the others from the results folder.`
    : "";
  drawCaptions();
  if (isNear()) sharpen();
});

function tile(view, which) {
  const frame = frameOf(view, which);
  const name = h(
    "span",
    { class: "caption" },
    summary.colours[which] ? dot(which) : "",
    h("b", {}, pictureName(which)),
    h("span", { class: "dim" }),
  );
  return h(
    "button",
    {
      type: "button",
      class: "tile",
      "data-which": which,
      click: (event) => choose(event.altKey ? { before: which } : { method: which }),
    },
    frame,
    name,
  );
}

watch(["method", "before", "metric"], drawCaptions);

// Which pictures the slider shows, and each one's score.
function drawCaptions() {
  const [view, column] = [viewOf(state.view), columnOf(state.metric)];
  if (!view) return;
  for (const button of $("grid").children) {
    const { which } = button.dataset;
    button.setAttribute("aria-pressed", String(which === state.method));
    button.classList.toggle("left", which === state.before);
    const value = view.results[data.methods.findIndex((m) => m.label === which)]?.scores?.[state.metric];
    button.querySelector(".dim").textContent =
      value === undefined || value === null || !column ? "" : `${titled(column)} ${number(value)} ${column.unit}`;
  }
}
