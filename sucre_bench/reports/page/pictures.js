// A view before and after, and beside it all methods on that view.

import { $, REFERENCE, VIEW, address, choose, data, embedded, fill, state, viewOf, watch } from "./page.js";
import { pictureName } from "./words.js";
import { isNear, onNear, zoomable } from "./zoom.js";

const stage = $("stage");
let divided = 50;

// Put the divider at this share of the width, in per cent.
function divide(place) {
  divided = Math.min(100, Math.max(0, place));
  stage.style.setProperty("--divided", `${divided}%`);
  $("divider").setAttribute("aria-valuenow", String(Math.round(divided)));
  $("divider").setAttribute("aria-valuetext", `${Math.round(divided)} % of the width is ${pictureName(state.before)}`);
}

// What there is of a picture: {picture, holes, confidence, text}, text where there is none.
export function shownOf(view, which) {
  if (which === VIEW) return { picture: view.original, text: "no picture was kept" };
  if (which === REFERENCE) return { picture: view.reference, text: "no reference" };
  const result = view.results[data.methods.findIndex((m) => m.label === which)];
  if (!result) return { picture: null, text: "not run" };
  if (!result.picture)
    return {
      picture: null,
      text: [result.status === "ok" ? "no picture was kept" : result.status, result.reason].filter(Boolean).join(": "),
      status: result.status,
    };
  const id = result.picture.id;
  return {
    picture: result.picture,
    holes: embedded(`${id}-holes`),
    confidence: embedded(`${id}-confidence`),
    about: $(`${id}-confidence`)?.dataset,
    result,
  };
}

// Show a picture in an <img>; from nearby, the full one from disk takes the thumbnail's place.
export function show(img, shown, alt) {
  const map = state.layer === "confidence" && shown.confidence;
  const source = map || address(shown.picture);
  img.hidden = !source;
  img.alt = alt;
  img.dataset.full = map || !shown.picture?.id ? "" : shown.picture.link;
  if (source && img.dataset.source !== source) {
    img.dataset.source = source;
    img.src = source;
  }
}

export function sharpen() {
  for (const img of $("pictures").querySelectorAll("img[data-full]:not([data-full=''])")) {
    const { full } = img.dataset;
    if (img.hidden || img.dataset.source === full || img.dataset.tried === full) continue;
    img.dataset.tried = full;
    const loading = new Image();
    loading.src = full;
    loading
      .decode()
      .then(() => {
        if (img.dataset.full === full) {
          img.dataset.source = full;
          img.src = full;
        }
      })
      .catch(() => {}); // the page was moved away from its pictures: the thumbnail stays
  }
}

watch(["dataset", "view", "method", "before", "layer"], () => {
  const view = viewOf(state.view);
  $("pictures").hidden = !data.views.some((v) => v.results.some((r) => r.status === "ok"));
  if ($("pictures").hidden) return;
  const labels = data.methods.map((m) => [m.label, m.label]);
  const others = [[VIEW, pictureName(VIEW)], ...(view.reference ? [[REFERENCE, pictureName(REFERENCE)]] : [])];
  fill(
    $("view"),
    data.views.map((v) => [v.name, v.name]),
    state.view,
  );
  fill($("before"), [...others, ...labels], state.before);
  fill($("after"), [...others, ...labels], state.method);
  for (const [side, which] of [
    ["left", state.before],
    ["right", state.method],
  ]) {
    const shown = shownOf(view, which);
    show($(side), shown, `${view.name}, ${pictureName(which)}`);
    $(`${side}-name`).textContent = shown.picture ? pictureName(which) : `${pictureName(which)}: ${shown.text}`;
    $(`${side}-holes`).hidden = !(state.layer === "holes" && shown.holes);
    if (shown.holes) $(`${side}-holes`).src = shown.holes;
  }
  const known = data.methods.map((m) => shownOf(view, m.label));
  $("layer-pick").hidden = !known.some((s) => s.holes || s.confidence) && state.layer === "picture";
  for (const [layer, has] of [
    ["holes", known.some((s) => s.holes)],
    ["confidence", known.some((s) => s.confidence)],
  ]) {
    $("layer").querySelector(`[value=${layer}]`).disabled = !has;
  }
  $("layer").value = state.layer;
  divide(divided);
  if (isNear()) sharpen();
});
onNear(sharpen);

$("right").addEventListener("load", (event) => fit(event.currentTarget));
$("left").addEventListener("load", (event) => fit(event.currentTarget));

function fit(img) {
  if (img.naturalWidth) $("pictures").style.setProperty("--aspect", String(img.naturalWidth / img.naturalHeight));
}

// -- hands ---------------------------------------------------------------------------------------------------

zoomable(stage, (share) => divide(100 * share));
$("divider").addEventListener("keydown", (event) => {
  const step = event.shiftKey ? 10 : 1;
  const to = {
    ArrowLeft: divided - step,
    ArrowDown: divided - step,
    ArrowRight: divided + step,
    ArrowUp: divided + step,
    PageUp: divided + 10,
    PageDown: divided - 10,
    Home: 0,
    End: 100,
  }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  divide(to);
});
$("view").addEventListener("change", (event) => choose({ view: event.currentTarget.value }));
$("before").addEventListener("change", (event) => choose({ before: event.currentTarget.value }));
$("after").addEventListener("change", (event) => choose({ method: event.currentTarget.value }));
$("layer").addEventListener("change", (event) => choose({ layer: event.currentTarget.value }));
export const swap = () => choose({ before: state.method, method: state.before });
$("swap").addEventListener("click", swap);

export function step(by) {
  const at = data.views.findIndex((v) => v.name === state.view) + by;
  if (data.views[at]) choose({ view: data.views[at].name });
}
$("earlier").addEventListener("click", () => step(-1));
$("later").addEventListener("click", () => step(1));
