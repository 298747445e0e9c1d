// All methods on this view.

import { $, REFERENCE, VIEW, choose, columnOf, data, h, shownMethods, state, summary, viewOf, watch } from "./page.js";
import { dot, number, pictureName, titled } from "./words.js";
import { isNear, zoomable } from "./zoom.js";
import { sharpen, show, shownOf } from "./pictures.js";

watch(["dataset", "view", "hidden", "layer"], () => {
  const view = viewOf(state.view);
  if (!view) return;
  const pictures = [VIEW, ...(view.reference ? [REFERENCE] : []), ...shownMethods().map((m) => m.label)];
  $("grid").replaceChildren(...pictures.map((which) => tile(view, which)));
  const missing = data.views.filter((v) => v.original && !v.original.id).length;
  $("pictures-note").textContent = missing
    ? `This page keeps the pictures of ${data.views.length - missing} of ${data.views.length} views, evenly spread; those of the others are read from the folder it lies in.`
    : "";
  drawCaptions();
  if (isNear()) sharpen();
});

function tile(view, which) {
  const shown = shownOf(view, which);
  const frame = h("span", { class: "frame" });
  if (shown.picture) {
    const img = h("img", { class: "zoomed", loading: "lazy", decoding: "async", draggable: "false" });
    show(img, shown, `${view.name}, ${pictureName(which)}`);
    frame.append(img);
    if (state.layer === "holes" && shown.holes)
      frame.append(h("img", { class: "zoomed over", src: shown.holes, alt: "" }));
    if (state.layer === "confidence" && !shown.confidence) frame.classList.add("pale");
    zoomable(frame);
  } else frame.append(h("span", { class: shown.status === "failed" ? "none bad" : "none" }, shown.text));
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
