// Up to four pictures beside each other, in place of the slider; all zoom in step.

import { $, choose, fill, h, state, viewOf, watch } from "./page.js";
import { pictureName } from "./words.js";
import { frameOf, picturesOf, sharpen } from "./pictures.js";
import { isNear } from "./zoom.js";

const MOST_PANELS = 4;
const NOTHING = "";

for (const button of document.querySelectorAll("[data-mode]"))
  button.addEventListener("click", () => choose({ mode: button.dataset.mode }));

watch(["dataset", "view", "mode", "panels", "layer", "guesses"], () => {
  const view = viewOf(state.view);
  if (!view) return;
  for (const button of document.querySelectorAll("[data-mode]"))
    button.setAttribute("aria-pressed", String(button.dataset.mode === state.mode));
  const hasPanels = state.mode === "panels";
  $("stage").hidden = $("sides").hidden = hasPanels;
  $("panels").hidden = !hasPanels;
  if (!hasPanels) return;
  $("panels").replaceChildren(...state.panels.map((which, at) => panel(view, which, at)), ...more(view));
  $("panels").style.setProperty("--columns", state.panels.length > 1 ? 2 : 1);
  if (isNear()) sharpen();
});

function panel(view, which, at) {
  const pick = h("select", {
    "aria-label": `picture ${at + 1}`,
    change: (event) => {
      const { value } = event.currentTarget;
      const next = state.panels.map((own, n) => (n === at ? value : own));
      choose({ panels: next.filter((own) => own !== NOTHING) });
    },
  });
  const none = state.panels.length > 1 ? [[NOTHING, "nothing"]] : [];
  fill(pick, [...picturesOf(view).map((own) => [own, pictureName(own)]), ...none], which);
  return h("div", { class: "panel", "data-which": which }, pick, frameOf(view, which));
}

// The button for one more, the first picture that is not shown.
function more(view) {
  const next = picturesOf(view).find((which) => !state.panels.includes(which));
  if (state.panels.length >= MOST_PANELS || next === undefined) return [];
  const add = () => choose({ panels: [...state.panels, next] });
  return [h("button", { type: "button", class: "more", click: add }, "One more picture")];
}
