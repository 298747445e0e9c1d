"use strict";
// Shows pairs of pictures, takes votes, chooses the next pair by what it will tell, and saves the votes as a file.

const byId = (id) => document.getElementById(id);
const content = JSON.parse(byId("content").textContent);
const methods = content.views[0].length;
const storageKey = `people's study ${content.study}`;
const PRIOR_VARIANCE = 4; // of a method's score, log-odds

// -- random draws ------------------------------------------------------------------------------------------

function random() {
  return crypto.getRandomValues(new Uint32Array(1))[0] / 2 ** 32;
}

function oneOf(items) {
  return items[Math.floor(random() * items.length)];
}

function newObserver() {
  return Array.from(crypto.getRandomValues(new Uint8Array(8)), (byte) => byte.toString(16).padStart(2, "0")).join("");
}

// -- what is kept in the browser ---------------------------------------------------------------------------

let state = { observer: newObserver(), votes: [], current: null, goal: content.pairs };

function restore() {
  try {
    const kept = JSON.parse(localStorage.getItem(storageKey));
    if (kept && Array.isArray(kept.votes)) state = kept;
  } catch {
    notice("Your browser cannot store votes for this page. Save your votes before you close it.");
  }
}

function keep() {
  try {
    localStorage.setItem(storageKey, JSON.stringify(state));
  } catch {
    notice("Your browser cannot store votes for this page. Save your votes before you close it.");
  }
}

function notice(text) {
  byId("notice").textContent = text;
  byId("notice").hidden = false;
}

// -- which pair comes next ---------------------------------------------------------------------------------

const place = new Map(); // picture -> [view, method]
content.views.forEach((pictures, view) => pictures.forEach((name, method) => place.set(name, [view, method])));

function solve(matrix, vector) { // Gauss-Jordan; the matrix is positive definite
  const rows = matrix.map((row, n) => [...row, vector[n]]);
  for (let n = 0; n < rows.length; n++) {
    const scale = rows[n][n];
    for (let k = 0; k <= rows.length; k++) rows[n][k] /= scale;
    for (let m = 0; m < rows.length; m++) {
      if (m === n) continue;
      const factor = rows[m][n];
      for (let k = 0; k <= rows.length; k++) rows[m][k] -= factor * rows[n][k];
    }
  }
  return rows.map((row) => row[rows.length]);
}

function prefers(scores, i, j) { // Bradley-Terry
  return 1 / (1 + Math.exp(scores[j] - scores[i]));
}

// The scores that fit this observer's votes best, given the prior, and the information matrix there.
function fitted() {
  let scores = new Array(methods).fill(0);
  let information = null;
  for (let step = 0; step < 12; step++) {
    const slope = scores.map((score) => -score / PRIOR_VARIANCE);
    information = scores.map((_, i) => scores.map((_, j) => (i === j ? 1 / PRIOR_VARIANCE : 0)));
    for (const vote of state.votes) {
      const i = place.get(vote.left)[1], j = place.get(vote.right)[1];
      const p = prefers(scores, i, j);
      const won = { left: 1, tie: 0.5, right: 0 }[vote.choice];
      slope[i] += won - p;
      slope[j] -= won - p;
      information[i][i] += p * (1 - p);
      information[j][j] += p * (1 - p);
      information[i][j] -= p * (1 - p);
      information[j][i] -= p * (1 - p);
    }
    const change = solve(information, slope);
    scores = scores.map((score, n) => score + change[n]);
  }
  return { scores, information };
}

// What a vote on methods i and j would tell: the expected growth of the information's determinant.
function gain({ scores, information }, i, j) {
  const p = prefers(scores, i, j);
  const direction = scores.map((_, n) => (n === i ? 1 : n === j ? -1 : 0));
  const spread = solve(information, direction);
  return p * (1 - p) * (spread[i] - spread[j]);
}

function unseen(i, j) { // views of which this observer has not judged the pair i, j
  const seen = new Set();
  for (const vote of state.votes) {
    const [view, a] = place.get(vote.left), b = place.get(vote.right)[1];
    if (Math.min(a, b) === i && Math.max(a, b) === j) seen.add(view);
  }
  return content.orders[`${i},${j}`].filter((view) => !seen.has(view));
}

function nextPair() {
  const model = fitted();
  const last = state.votes.at(-1);
  const lastPair = last ? [last.left, last.right].map((name) => place.get(name)[1]).sort((a, b) => a - b).join() : "";
  let options = [];
  for (let i = 0; i < methods; i++) {
    for (let j = i + 1; j < methods; j++) {
      const views = unseen(i, j);
      if (views.length) options.push({ i, j, views, gain: gain(model, i, j) });
    }
  }
  if (options.length > 1) options = options.filter(({ i, j }) => `${i},${j}` !== lastPair);
  if (!options.length) return null;
  const most = Math.max(...options.map((option) => option.gain));
  const { i, j, views } = oneOf(options.filter((option) => option.gain > most * 0.999));
  const view = state.votes.length % 2 ? oneOf(views) : views[0]; // every second pair is one that others judge, too
  const pair = [content.views[view][i], content.views[view][j]];
  if (random() < 0.5) pair.reverse();
  return { left: pair[0], right: pair[1] };
}

// -- showing and voting ------------------------------------------------------------------------------------

let shownSince = 0;

function show() {
  if (state.votes.length < state.goal && !state.current) state.current = nextPair();
  const isOver = state.votes.length >= state.goal || !state.current;
  byId("pair").hidden = isOver;
  byId("end").hidden = !isOver;
  byId("back").disabled = !state.votes.length;
  keep();
  if (isOver) {
    byId("thanks").textContent = `Thank you. You judged ${state.votes.length} pairs.`;
    byId("progress").textContent = "";
    byId("more").hidden = !nextPair();
    byId("save").focus();
    return;
  }
  const done = state.votes.length + 1 - (state.goal - content.pairs);
  byId("progress").textContent = `Pair ${done} of ${content.pairs}`;
  for (const side of ["left", "right"]) {
    const data = byId(`p-${state.current[side]}`).textContent;
    byId(side).firstElementChild.src = `data:image/jpeg;base64,${data}`;
  }
  lookAt(1, 0, 0);
  shownSince = performance.now();
}

function vote(choice) {
  if (byId("pair").hidden) return;
  const seconds = Math.round((performance.now() - shownSince) / 100) / 10;
  state.votes.push({ n: state.votes.length, ...state.current, choice, seconds });
  state.current = null;
  show();
}

function undo() {
  const last = state.votes.pop();
  if (!last) return;
  state.current = { left: last.left, right: last.right };
  state.goal = Math.max(content.pairs, Math.ceil((state.votes.length + 1) / content.pairs) * content.pairs);
  show();
}

function save() {
  const told = { format: "sucre_bench votes", version: 1, study: content.study, observer: state.observer, votes: state.votes };
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([JSON.stringify(told, null, 1)], { type: "application/json" }));
  link.download = `votes-${content.study}-${state.observer.slice(0, 6)}.json`;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

// -- zoom, both pictures in step ---------------------------------------------------------------------------

let zoom = { scale: 1, x: 0, y: 0 }; // x, y: where the pictures' left and top are, in widths and heights of a frame

function lookAt(scale, x, y) {
  scale = Math.min(Math.max(scale, 1), 16);
  zoom = { scale, x: Math.min(Math.max(x, 1 - scale), 0), y: Math.min(Math.max(y, 1 - scale), 0) };
  for (const side of ["left", "right"]) {
    const image = byId(side).firstElementChild;
    image.style.transform = `translate(${100 * zoom.x}%, ${100 * zoom.y}%) scale(${zoom.scale})`;
  }
}

function zoomBy(factor, x = 0.5, y = 0.5) { // x, y: the point of a frame that stays where it is
  const scale = Math.min(Math.max(zoom.scale * factor, 1), 16);
  const change = scale / zoom.scale;
  lookAt(scale, x - change * (x - zoom.x), y - change * (y - zoom.y));
}

for (const side of ["left", "right"]) {
  const frame = byId(side);
  frame.addEventListener("wheel", (event) => {
    event.preventDefault();
    const box = frame.getBoundingClientRect();
    const at = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    zoomBy(Math.exp(-event.deltaY / 300), ...at);
  }, { passive: false });
  frame.addEventListener("pointerdown", (event) => frame.setPointerCapture(event.pointerId));
  frame.addEventListener("pointermove", (event) => {
    if (!frame.hasPointerCapture(event.pointerId)) return;
    const box = frame.getBoundingClientRect();
    lookAt(zoom.scale, zoom.x + event.movementX / box.width, zoom.y + event.movementY / box.height);
  });
}

const KEYS = {
  ArrowLeft: () => vote("left"), ArrowRight: () => vote("right"), ArrowDown: () => vote("tie"),
  Backspace: undo, "+": () => zoomBy(1.5), "=": () => zoomBy(1.5), "-": () => zoomBy(1 / 1.5), 0: () => lookAt(1, 0, 0),
};

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat || !KEYS[event.key]) return;
  event.preventDefault();
  KEYS[event.key]();
});
for (const [id, act] of Object.entries({
  "choose-left": () => vote("left"), "choose-tie": () => vote("tie"), "choose-right": () => vote("right"),
  back: undo, save, more: () => { state.goal += content.pairs; show(); },
})) byId(id).addEventListener("click", act);

restore();
show();
