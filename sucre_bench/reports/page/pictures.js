// A view before and after, and below it all methods on that view.

const stage = $("stage");
const urls = new Map();
let divided = 50;

// The address of a picture in the page, decoded when it is first asked for; null where the page has none.
function embedded(id) {
  const block = id && $(id);
  if (!block) return null;
  if (!urls.has(id)) {
    const bytes = Uint8Array.from(atob(block.textContent), (letter) => letter.charCodeAt(0));
    urls.set(id, URL.createObjectURL(new Blob([bytes], { type: block.dataset.kind })));
  }
  return urls.get(id);
}

const address = (picture) => picture && (embedded(picture.id) || picture.link);

// Put the divider at this share of the width, in per cent.
function divide(place) {
  divided = Math.min(100, Math.max(0, place));
  stage.style.setProperty("--divided", `${divided}%`);
  $("divider").setAttribute("aria-valuenow", String(Math.round(divided)));
  $("divider").setAttribute("aria-valuetext", `${Math.round(divided)} % of the width is ${pictureName(state.before)}`);
}

// What there is of a picture: {picture, holes, guesses, confidence, text}, text where there is none. guesses: the share of
// its pixels whose colour fill=true guessed.
function shownOf(view, which) {
  if (which === VIEW) return { picture: view.original, text: "no picture was kept" };
  if (which === REFERENCE) return { picture: view.reference, text: "no reference" };
  const result = view.results[placeOf(which)];
  if (!result) return { picture: null, text: "not run" };
  if (!result.picture) {
    const what = result.status === "ok" ? "no picture was kept" : result.status;
    return { picture: null, text: [what, result.reason].filter(Boolean).join(": "), status: result.status };
  }
  const id = result.picture.id;
  return {
    picture: result.picture,
    holes: embedded(`${id}-holes`),
    guesses: Number($(`${id}-holes`)?.dataset.guesses || 0),
    confidence: embedded(`${id}-confidence`),
    about: $(`${id}-confidence`)?.dataset,
  };
}

// Show a picture in an <img>; full: the picture on disk that takes the thumbnail's place from nearby.
function show(img, source, full = "") {
  img.hidden = !source;
  img.dataset.full = source ? full : "";
  if (!source || img.dataset.source === source) return;
  img.dataset.source = source;
  img.src = source;
}

// Show a picture of a view in three images: itself or its confidence, the reference that the style sheet turns into the
// difference of the two, and what lies over the pixels that a method has no colour for.
function showAll([picture, error, holes], view, which) {
  const shown = shownOf(view, which);
  const map = state.layer === "confidence" && shown.confidence;
  show(picture, map || address(shown.picture), map || !shown.picture?.id ? "" : shown.picture.link);
  picture.alt = `${view.name}, ${pictureName(which)}`;
  const hasError = state.layer === "error" && view.reference && which !== REFERENCE && shown.picture;
  show(error, hasError && address(view.reference), view.reference?.link);
  error.parentElement.classList.toggle("error", Boolean(hasError));
  const isBlack = state.layer === "picture" && !state.guesses && shown.guesses > 0;
  show(holes, (isBlack || state.layer === "holes") && shown.holes);
  holes.classList.toggle("black", isBlack);
  return shown;
}

function drawStage() {
  const view = viewNow();
  if (!view || $("pictures").hidden) return;
  fill($("view"), data.views.map((v) => [v.name, v.name]), state.view); // prettier-ignore
  const options = picturesOf(view).map((which) => [which, pictureName(which)]);
  fill($("before"), options, state.before);
  fill($("after"), options, state.method);
  for (const [side, which] of [["left", state.before], ["right", state.method]]) { // prettier-ignore
    const shown = showAll([$(side), $(`${side}-error`), $(`${side}-holes`)], view, which);
    $(`${side}-name`).textContent = shown.picture ? pictureName(which) : `${pictureName(which)}: ${shown.text}`;
  }
  const known = data.methods.map((m) => ({ label: m.label, ...shownOf(view, m.label) }));
  const has = { error: view.reference, holes: known.some((s) => s.holes), confidence: known.some((s) => s.confidence) };
  $("layer-pick").hidden = !Object.values(has).some(Boolean) && state.layer === "picture";
  for (const layer of Object.keys(has)) $("layer").querySelector(`[value=${layer}]`).disabled = !has[layer];
  $("layer").value = state.layer;
  const guessing = known.filter((s) => s.guesses);
  $("guesses-pick").hidden = !guessing.length || state.layer !== "picture";
  $("guesses").checked = state.guesses;
  $("layer-note").textContent = legendOf(guessing);
  $("layer-note").hidden = !$("layer-note").textContent;
  divide(divided);
  if (isNear()) sharpen();
}

// What the layer shows, and what is drawn that was not measured, by whom.
function legendOf(guessing) {
  if (state.layer === "holes") return "Stripes: pixels without a measured colour. No score counts them.";
  if (state.layer === "error") return "Black is equal to the reference. Differences are shown four times as bright.";
  if (state.layer !== "picture" || !guessing.length) return "";
  const who = guessing.map((s) => `${s.label} ${percent(s.guesses)}`).join(", ");
  const black = state.guesses ? "" : " They are black now.";
  return `Guessed colours: fill=true draws pixels without depth, and no score counts them.${black} Their share of this view: ${who}.`;
}

// Every picture of a view, by name: the photograph once.
const picturesOf = (view) => [
  ...(data.photographs.length ? [] : [VIEW]),
  ...(view.reference ? [REFERENCE] : []),
  ...data.methods.map((m) => m.label),
];

// From nearby, the full pictures on disk take the thumbnails' place.
function sharpen() {
  for (const img of $("pictures").querySelectorAll("img[data-full]:not([data-full=''], [hidden])")) {
    const { full } = img.dataset;
    if (img.dataset.tried === full) continue;
    img.dataset.tried = full;
    const loading = new Image();
    loading.src = full;
    loading.decode().then(
      () => img.dataset.full === full && show(img, full, full),
      () => {}, // the page was moved away from its pictures: the thumbnail stays
    );
  }
}

for (const side of ["left", "right"])
  $(side).addEventListener("load", (event) => {
    const { naturalWidth, naturalHeight } = event.currentTarget;
    if (naturalWidth) $("pictures").style.setProperty("--aspect", String(naturalWidth / naturalHeight));
  });

// -- all methods on the view -------------------------------------------------------------------------------

function drawGrid() {
  const view = viewNow();
  if (!view) return;
  $("grid").replaceChildren(...picturesOf(view).map((which) => tile(view, which)));
  const missing = data.views.filter((v) => v.original && !v.original.id).length;
  $("pictures-note").textContent = missing
    ? `This page contains the pictures of ${data.views.length - missing} of ${data.views.length} views, evenly spread. It reads the others from the results folder.`
    : "";
  if (isNear()) sharpen();
}

function tile(view, which) {
  const images = [1, 2, 3].map((layer) =>
    h("img", { class: layer === 2 ? "zoomed minus" : "zoomed", alt: "", draggable: "false" }),
  );
  const frame = h("span", { class: "frame" }, images);
  const shown = showAll(images, view, which);
  if (!shown.picture) frame.replaceChildren(h("span", { class: shown.status === "failed" ? "none bad" : "none" }, shown.text));
  else zoomable(frame);
  frame.classList.toggle("pale", state.layer === "confidence" && !shown.confidence);
  const name = h("b", {}, placeOf(which) < 0 ? null : dot(which), pictureName(which));
  const caption = h("span", { class: "caption" }, name, h("span", { class: "dim" }));
  return h("button", { type: "button", class: "tile", "data-which": which, "data-method": which }, frame, caption);
}

// Which pictures the slider shows, and each one's score.
function drawCaptions() {
  const column = columnOf(state.metric);
  for (const button of $("grid").children) {
    const { which } = button.dataset;
    button.ariaPressed = String(which === state.method);
    button.classList.toggle("left", which === state.before);
    const value = viewNow().results[placeOf(which)]?.scores?.[state.metric];
    const known = value !== undefined && value !== null && column;
    button.querySelector(".dim").textContent = known ? `${titled(column)} ${number(value)} ${column.unit}` : "";
  }
}

// -- hands -------------------------------------------------------------------------------------------------

zoomable(stage, (share) => divide(100 * share));
$("divider").addEventListener("keydown", (event) => {
  const by = event.shiftKey ? 10 : 1;
  const to = { ArrowLeft: divided - by, ArrowRight: divided + by, Home: 0, End: 100 }[event.key];
  if (to === undefined) return;
  event.preventDefault();
  divide(to);
});
for (const [id, key] of [["view", "view"], ["before", "before"], ["after", "method"], ["layer", "layer"]]) // prettier-ignore
  $(id).addEventListener("change", (event) => choose({ [key]: event.currentTarget.value }));
$("guesses").addEventListener("change", (event) => choose({ guesses: event.currentTarget.checked }));
const swap = () => choose({ before: state.method, method: state.before });
$("swap").addEventListener("click", swap);

function step(by) {
  const at = data.views.findIndex((v) => v.name === state.view) + by;
  if (data.views[at]) choose({ view: data.views[at].name });
}
$("earlier").addEventListener("click", () => step(-1));
$("later").addEventListener("click", () => step(1));
