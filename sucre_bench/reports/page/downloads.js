// Files to keep: the table as CSV, all scores as they lie in the results folder, and the pictures that are looked at.

import { $, address, columnOf, data, h, state, viewOf, watch } from "./page.js";
import { number, pictureName, titled } from "./words.js";
import { overHoles, shownOf } from "./pictures.js";

const CAPTION = 34; // pixels below each picture

function save(blob, name) {
  const link = h("a", { href: URL.createObjectURL(blob), download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

const fileName = (text) => text.replaceAll(/[^\w.,=+@-]+/g, "_");

watch(["dataset"], () => {
  const csv = data.exports.find((one) => one.name === "CSV");
  const keep = () => save(new Blob([csv.text], { type: "text/csv" }), `${fileName(data.name)}.csv`);
  $("download-menu").replaceChildren(
    h("button", { type: "button", id: "download-csv", click: keep }, "This table, CSV"),
    h("a", { id: "download-parquet", href: "../scores.parquet", download: "scores.parquet" }, "Every score, Parquet"),
    h("button", { type: "button", id: "download-png", click: savePicture }, "These pictures, PNG"),
  );
});

// The pictures that are looked at, beside each other, with their names and scores below.
export async function pictureOfView() {
  const view = viewOf(state.view);
  const names = state.mode === "panels" ? state.panels : [state.before, state.method];
  const loaded = await Promise.all(
    names.map(async (which) => {
      const shown = shownOf(view, which);
      const over = overHoles(shown) === "black" ? shown.holes : null;
      return [which, await decodedImage(address(shown.picture)), await decodedImage(over)];
    }),
  );
  const known = loaded.filter(([, img]) => img);
  const [width, height] = known.length ? [known[0][1].naturalWidth, known[0][1].naturalHeight] : [1, 1];
  const canvas = h("canvas", { width: known.length * width, height: height + CAPTION });
  const ink = canvas.getContext("2d");
  ink.fillStyle = "#fff";
  ink.fillRect(0, 0, canvas.width, canvas.height);
  ink.fillStyle = "#1b2328";
  ink.font = "16px sans-serif";
  known.forEach(([which, img, over], at) => {
    ink.drawImage(img, at * width, 0, width, height);
    if (over) {
      ink.filter = "brightness(0)"; // as the style sheet hides guessed colours
      ink.drawImage(over, at * width, 0, width, height);
      ink.filter = "none";
    }
    ink.fillText(`${pictureName(which)}${scoreOf(view, which)}`, at * width + 8, height + 22, width - 16);
  });
  return canvas;
}

async function decodedImage(source) {
  if (!source) return null;
  const img = new Image();
  img.src = source;
  await img.decode();
  return img;
}

function scoreOf(view, which) {
  const column = columnOf(state.metric);
  const score = view.results[data.methods.findIndex((m) => m.label === which)]?.scores?.[state.metric];
  return score === undefined || score === null || !column ? "" : `, ${titled(column)} ${number(score)} ${column.unit}`;
}

async function savePicture() {
  const canvas = await pictureOfView();
  try {
    canvas.toBlob((blob) => save(blob, `${fileName(`${data.name}-${state.view.replace(/\.\w+$/, "")}`)}.png`));
  } catch {
    // a picture that the page does not hold itself cannot be read back
    $("announcement").textContent = "the page holds no copy of these pictures";
  }
}
