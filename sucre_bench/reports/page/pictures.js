// A view before and after, and beside it all methods on that view.

import { $, REFERENCE, VIEW, address, choose, data, embedded, fill, h, state, viewOf, watch } from "./page.js";
import { percent, pictureName } from "./words.js";
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

// What there is of a picture: {picture, holes, guesses, confidence, text}, text where there is none. guesses: the share of
// its pixels whose colour fill=true guessed.
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
    guesses: Number($(`${id}-holes`)?.dataset.guesses || 0),
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

// Lay the reference over a picture, which the style sheet turns into the difference of the two.
export function showError(img, view, which, shown) {
  const has = state.layer === "error" && view.reference && which !== REFERENCE && shown.picture;
  img.hidden = !has;
  img.parentElement.classList.toggle("error", Boolean(has));
  img.dataset.full = has ? view.reference.link : "";
  if (!has || img.dataset.source === address(view.reference)) return;
  img.dataset.source = address(view.reference);
  img.src = img.dataset.source;
}

// What lies over the pixels that a method has no colour for: stripes, nothing but black, or "".
export function overHoles(shown) {
  if (!shown.holes) return "";
  if (state.layer === "holes") return "stripes";
  return state.layer === "picture" && state.guesses === "hidden" && shown.guesses ? "black" : "";
}

function showHoles(img, shown) {
  const over = overHoles(shown);
  img.hidden = !over;
  img.className = `zoomed over ${over}`;
  if (over) img.src = shown.holes;
}

// Every picture of a view, by name: the photograph once.
export const picturesOf = (view) => {
  const reference = view.reference ? [REFERENCE] : [];
  const first = data.photographs.length ? [] : [VIEW];
  return [...first, ...reference, ...data.methods.map((m) => m.label)];
};

// A frame with a picture of a view, its holes or its error, which zooms with all others.
export function frameOf(view, which) {
  const shown = shownOf(view, which);
  const frame = h("span", { class: "frame" });
  if (!shown.picture) {
    frame.append(h("span", { class: shown.status === "failed" ? "none bad" : "none" }, shown.text));
    return frame;
  }
  const img = h("img", { class: "zoomed", loading: "lazy", decoding: "async", draggable: "false" });
  show(img, shown, `${view.name}, ${pictureName(which)}`);
  frame.append(img);
  if (state.layer === "error") {
    const error = h("img", { class: "zoomed over minus", alt: "" });
    frame.append(error);
    showError(error, view, which, shown);
  }
  const holes = h("img", { alt: "" });
  showHoles(holes, shown);
  if (!holes.hidden) frame.append(holes);
  if (state.layer === "confidence" && !shown.confidence) frame.classList.add("pale");
  zoomable(frame);
  return frame;
}

// What is drawn that was not measured, and by whom; what the layer shows.
function showLegend(guessing) {
  $("guesses-pick").hidden = !guessing.length || state.layer !== "picture";
  $("guesses").checked = state.guesses === "shown";
  const who = guessing.map((s) => `${s.label} ${percent(s.guesses)}`).join(", ");
  const text = {
    holes: "Stripes: pixels without a measured colour. No score counts them.",
    error: "Black is equal to the reference. Differences are shown four times as bright.",
  }[state.layer];
  const black = state.guesses === "hidden" ? " They are black now." : "";
  const guessed = `Guessed colours: fill=true draws pixels without depth, and no score counts them.${black} Their share of this view: ${who}.`;
  $("layer-note").textContent = text || (state.layer === "picture" && guessing.length ? guessed : "");
  $("layer-note").hidden = !$("layer-note").textContent;
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

watch(["dataset", "view", "method", "before", "layer", "guesses"], () => {
  const view = viewOf(state.view);
  $("pictures").hidden = !data.views.some((v) => v.results.some((r) => r.status === "ok"));
  if ($("pictures").hidden) return;
  fill(
    $("view"),
    data.views.map((v) => [v.name, v.name]),
    state.view,
  );
  const options = picturesOf(view).map((which) => [which, pictureName(which)]);
  fill($("before"), options, state.before);
  fill($("after"), options, state.method);
  for (const [side, which] of [
    ["left", state.before],
    ["right", state.method],
  ]) {
    const shown = shownOf(view, which);
    show($(side), shown, `${view.name}, ${pictureName(which)}`);
    $(`${side}-name`).textContent = shown.picture ? pictureName(which) : `${pictureName(which)}: ${shown.text}`;
    showHoles($(`${side}-holes`), shown);
    showError($(`${side}-error`), view, which, shown);
  }
  const known = data.methods.map((m) => ({ label: m.label, ...shownOf(view, m.label) }));
  showLegend(known.filter((s) => s.guesses));
  $("layer-pick").hidden = !view.reference && !known.some((s) => s.holes || s.confidence) && state.layer === "picture";
  for (const [layer, has] of [
    ["error", Boolean(view.reference)],
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
$("guesses").addEventListener("change", (event) => choose({ guesses: event.currentTarget.checked ? "shown" : "hidden" }));
export const swap = () => choose({ before: state.method, method: state.before });
$("swap").addEventListener("click", swap);

export function step(by) {
  const at = data.views.findIndex((v) => v.name === state.view) + by;
  if (data.views[at]) choose({ view: data.views[at].name });
}
$("earlier").addEventListener("click", () => step(-1));
$("later").addEventListener("click", () => step(1));
