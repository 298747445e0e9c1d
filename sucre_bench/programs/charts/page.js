// The page of `sucre-bench charts`: one view at a time, four corners a chart. Coordinates are pixels of the image,
// (0, 0) its top left corner. Everything that is decided is decided by the server; the page only asks and draws.
"use strict";

const CORNERS = ["top left", "top right", "bottom right", "bottom left"];
const byId = (id) => document.getElementById(id);
const photo = byId("photo"), loupe = byId("loupe");

let state = null;        // what the server said last
let at = 0;              // the view shown
let image = null;        // its picture, once it is there
let zoom = 1, left = 0, top_ = 0;  // screen = (image - [left, top_]) * zoom
let chart = null;        // being edited: {name, kind, corners, from, original}
let corner = 0;          // of it, that the keys move
let pointer = [0, 0], drag = null;

async function ask(path, body) {
  const options = body === undefined ? {} :
    { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  const reply = await fetch(path, options);
  if (!reply.ok) throw new Error(await reply.text());
  return reply.json();
}

const say = (text) => { byId("said").textContent = text; };
const view = () => state.views[at];

// -- views --------------------------------------------------------------------------------------------------------

function listViews() {
  const list = byId("views");
  list.replaceChildren(...state.views.map((one, number) => {
    const marks = `${one.charts.length} marked` + (one.proposed.length ? `, ${one.proposed.length} to confirm` : "");
    return new Option(`${one.name}  (${marks})`, number, false, number === at);
  }));
}

function show(number) {
  at = (number + state.views.length) % state.views.length;
  image = null;
  edit(null);
  listViews();
  load();
}

function load(keepPlace = false) {
  const wanted = at, picture = new Image();
  say("loading the view ...");
  picture.onload = () => {
    if (wanted !== at) return;
    image = picture;
    if (!keepPlace) fit();
    say(state.file);
    draw();
  };
  picture.onerror = async () => {
    const reply = await fetch(picture.src);
    say(reply.ok ? "the view cannot be shown" : await reply.text());
    draw();
  };
  picture.src = `image?view=${at}&bright=${byId("bright").checked ? 1 : 0}`;
}

// -- charts -------------------------------------------------------------------------------------------------------

function listCharts() {
  const entry = (one, proposed) => {
    const item = document.createElement("li");
    item.textContent = `${one.name}: ${one.kind}` + (proposed ? `, from ${one.from}, to be confirmed` : "");
    item.classList.toggle("proposed", proposed);
    item.classList.toggle("chosen", chart !== null && chart.original === one.name);
    item.onclick = () => edit(one, proposed);
    return item;
  };
  byId("charts").replaceChildren(...view().charts.map((one) => entry(one, false)),
    ...view().proposed.map((one) => entry(one, true)));
}

const allNames = () => new Set(state.views.flatMap((one) => [...one.charts, ...one.proposed].map((c) => c.name)));

function freeName() {
  const taken = allNames();
  let number = 1;
  while (taken.has(`chart${number}`)) number += 1;
  return `chart${number}`;
}

function edit(one, proposed = false) {
  corner = 0;
  chart = one === null ? { name: freeName(), kind: byId("kind").value || state.kinds[0], corners: [], original: null } :
    { name: one.name, kind: one.kind, corners: one.corners.map((c) => [...c]), original: one.name, proposed };
  byId("name").value = chart.name;
  byId("kind").value = chart.kind;
  byId("names").replaceChildren(...[...allNames()].map((name) => new Option(name)));  // one chart, one name in all views
  changed();
}

let checking = 0;
async function changed() {
  const whole = chart.corners.length === 4;
  byId("hint").textContent = whole ? `${CORNERS[corner]} corner chosen; check the colours, then confirm` :
    `Click the ${CORNERS[chart.corners.length]} corner`;
  byId("confirm").disabled = !whole;
  byId("turn").disabled = !whole;
  listCharts();
  draw();
  const number = ++checking;
  if (!whole) { byId("preview").hidden = true; return; }
  let seen;
  try {
    seen = await ask("check", { number: at, kind: chart.kind, corners: chart.corners });
  } catch (fault) {
    seen = { fault: fault.message, patches: [] };
  }
  if (number !== checking) return;  // a later change has asked again
  byId("preview").hidden = false;
  byId("fault").textContent = seen.fault || `patches in order (${Math.round(100 * seen.explained)} % explained)`;
  byId("fault").classList.toggle("fine", !seen.fault);
  if (seen.aspect) drawExpected(seen);
}

function drawExpected(seen) {
  const canvas = byId("expected"), pen = canvas.getContext("2d");
  canvas.width = 300; canvas.height = Math.round(300 / seen.aspect);
  pen.fillStyle = "#000"; pen.fillRect(0, 0, canvas.width, canvas.height);
  for (const { box: [x0, y0, x1, y1], expected, measured } of seen.patches) {
    const [x, y, w, h] = [x0 * canvas.width, y0 * canvas.height, (x1 - x0) * canvas.width, (y1 - y0) * canvas.height];
    pen.fillStyle = expected; pen.fillRect(x, y, w, h);
    pen.fillStyle = measured || "#000"; pen.fillRect(x + w / 4, y + h / 4, w / 2, h / 2);
  }
}

async function send(charts, turnedDown = []) {
  try {
    state = await ask("save", { number: at, charts, turned_down: turnedDown });
    listViews();
    edit(null);
    say(`saved to ${state.file}`);
  } catch (fault) {
    say(fault.message);
  }
}

const others = () => view().charts.filter((one) => one.name !== chart.original);
const plain = ({ name, kind, corners }) => ({ name, kind, corners });

function confirmChart() {
  if (chart.corners.length < 4) return;
  const renamed = chart.proposed && chart.name !== chart.original ? [chart.original] : [];
  send([...others(), chart].map(plain), renamed);
}

function drop() {
  if (chart.original === null) edit(null);
  else send(others().map(plain), [chart.original]);
}

function turn() {
  chart.corners.push(chart.corners.shift());
  changed();
}

// -- drawing ------------------------------------------------------------------------------------------------------

function fit() {
  if (!image) return;
  zoom = Math.min(photo.width / image.width, photo.height / image.height);
  left = (image.width - photo.width / zoom) / 2;
  top_ = (image.height - photo.height / zoom) / 2;
}

const toScreen = ([x, y]) => [(x - left) * zoom, (y - top_) * zoom];
const toImage = ([x, y]) => [x / zoom + left, y / zoom + top_];

function outline(pen, corners, colour, dashed) {
  if (!corners.length) return;
  pen.strokeStyle = colour; pen.lineWidth = 2; pen.setLineDash(dashed ? [6, 5] : []);
  pen.beginPath();
  corners.map(toScreen).forEach(([x, y], i) => (i ? pen.lineTo(x, y) : pen.moveTo(x, y)));
  if (corners.length === 4) pen.closePath();
  pen.stroke(); pen.setLineDash([]);
}

function draw() {
  const pen = photo.getContext("2d");
  pen.clearRect(0, 0, photo.width, photo.height);
  if (!image) return;
  pen.imageSmoothingEnabled = zoom < 2;
  pen.drawImage(image, -left * zoom, -top_ * zoom, image.width * zoom, image.height * zoom);
  for (const one of view().charts) if (one.name !== chart.original) outline(pen, one.corners, "#37d67a", false);
  for (const one of view().proposed) if (one.name !== chart.original) outline(pen, one.corners, "#ffb020", true);
  outline(pen, chart.corners, "#ff3b6b", false);
  chart.corners.forEach((place, i) => {
    const [x, y] = toScreen(place);
    pen.beginPath(); pen.arc(x, y, i === corner ? 7 : 5, 0, 7); pen.stroke();
    pen.fillStyle = "#fff"; pen.fillText(String(i + 1), x + 8, y - 8);
  });
  magnify();
}

function magnify() {
  const pen = loupe.getContext("2d"), [x, y] = toImage(pointer), span = loupe.width / 10;
  pen.imageSmoothingEnabled = false;
  pen.fillStyle = "#222"; pen.fillRect(0, 0, loupe.width, loupe.height);
  if (image) pen.drawImage(image, x - span / 2, y - span / 2, span, span, 0, 0, loupe.width, loupe.height);
  pen.strokeStyle = "#ff3b6b"; pen.lineWidth = 1;
  pen.beginPath();
  pen.moveTo(loupe.width / 2, 0); pen.lineTo(loupe.width / 2, loupe.height);
  pen.moveTo(0, loupe.height / 2); pen.lineTo(loupe.width, loupe.height / 2);
  pen.stroke();
}

function resize() {
  const box = photo.getBoundingClientRect();
  photo.width = Math.round(box.width); photo.height = Math.round(box.height);
  fit(); draw();
}

// -- hands --------------------------------------------------------------------------------------------------------

const place = (event) => [event.offsetX * photo.width / photo.clientWidth, event.offsetY * photo.height / photo.clientHeight];
const near = (spot) => chart.corners.findIndex((c) => Math.hypot(...toScreen(c).map((v, i) => v - spot[i])) < 9);

photo.onpointerdown = (event) => {
  if (!image) return;
  photo.focus(); photo.setPointerCapture(event.pointerId);
  const spot = place(event), grabbed = near(spot);
  drag = { spot, left, top: top_, grabbed, moved: false };
  if (grabbed >= 0) corner = grabbed;
};
photo.onpointermove = (event) => {
  pointer = place(event);
  if (!drag) { magnify(); return; }
  const [dx, dy] = pointer.map((v, i) => v - drag.spot[i]);
  drag.moved ||= Math.hypot(dx, dy) > 4;
  if (drag.grabbed >= 0 && drag.moved) chart.corners[drag.grabbed] = inside(toImage(pointer));
  else if (drag.moved) { left = drag.left - dx / zoom; top_ = drag.top - dy / zoom; }
  draw();
};
photo.onpointerup = () => {
  if (!drag) return;
  const { moved, grabbed, spot } = drag;
  drag = null;
  if (!moved && grabbed < 0 && chart.corners.length < 4) chart.corners.push(inside(toImage(spot)));
  if (!moved || grabbed >= 0) changed();
};
photo.addEventListener("wheel", (event) => {
  event.preventDefault();
  const spot = place(event), [x, y] = toImage(spot);
  zoom = Math.min(40, Math.max(0.05, zoom * Math.exp(-event.deltaY / 400)));
  left = x - spot[0] / zoom; top_ = y - spot[1] / zoom;
  draw();
}, { passive: false });

const inside = ([x, y]) => [Math.min(Math.max(x, 0), image.width), Math.min(Math.max(y, 0), image.height)];

function nudge(dx, dy, far) {
  const step = far ? 5 : 0.25, moved = chart.corners[corner];
  if (!moved || !image) return;
  chart.corners[corner] = inside([moved[0] + dx * step, moved[1] + dy * step]);
  pointer = toScreen(chart.corners[corner]);
  changed();
}

const KEYS = {
  n: () => show(at + 1), p: () => show(at - 1), r: () => chart.corners.length === 4 && turn(),
  b: () => { byId("bright").checked = !byId("bright").checked; load(true); },
  0: () => { fit(); draw(); }, Enter: confirmChart, Escape: () => edit(null), Delete: drop, Backspace: drop,
  ArrowLeft: (far) => nudge(-1, 0, far), ArrowRight: (far) => nudge(1, 0, far),
  ArrowUp: (far) => nudge(0, -1, far), ArrowDown: (far) => nudge(0, 1, far),
};
for (const number of [1, 2, 3, 4]) KEYS[number] = () => { corner = number - 1; changed(); };

document.addEventListener("keydown", (event) => {
  if (event.target.matches("input, select, button, summary") || event.ctrlKey || event.metaKey || event.altKey) return;
  const act = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (act && state) { event.preventDefault(); act(event.shiftKey); }
});

byId("chart").onsubmit = (event) => { event.preventDefault(); confirmChart(); };
byId("name").oninput = () => { chart.name = byId("name").value.trim(); };
byId("kind").onchange = () => { chart.kind = byId("kind").value; changed(); };
byId("turn").onclick = turn;
byId("drop").onclick = drop;
byId("cancel").onclick = () => edit(null);
byId("previous").onclick = () => show(at - 1);
byId("next").onclick = () => show(at + 1);
byId("views").onchange = () => show(Number(byId("views").value));
byId("bright").onchange = () => load(true);
byId("done").onclick = async () => {
  try { await ask("done", {}); } catch { /* it is gone already */ }
  document.body.textContent = "Done. This page can be closed.";
};
window.onresize = resize;

(async () => {
  try {
    state = await ask("state");
  } catch (fault) {
    say(fault.message);
    return;
  }
  byId("kind").replaceChildren(...state.kinds.map((kind) => new Option(kind, kind)));
  resize();
  show(0);
})();
