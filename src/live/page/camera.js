// The camera: the newest frame, and what scripts found in it.

import { h, remember, remembered, say, since, stamp, visible } from "./dom.js";
import { t } from "./texts.js";

/** Findings older than this are not drawn, milliseconds. */
const FRESH = 1000;
/** A picture older than this is shown in grey, with its age; milliseconds. */
const STALE = 2000;

export function camera(connection) {
  const image = h("img", { class: "frame", alt: t("camera_alt"), hidden: true });
  const overlay = h("canvas", { class: "overlay", "aria-hidden": "true" });
  const note = h("p", { class: "placeholder" }, t("camera_wait"));
  const rate = h("span", { class: "quiet" });
  const age = h("p", { class: "age", hidden: true });
  const stage = h("div", { class: "stage" }, image, overlay, note, age);
  const found = new Map();
  let possible = true;
  let shown = null;
  let came = stamp();
  /** Whether the clock of a simulation stands, and its pictures with it. */
  let paused = false;

  const box = (id, key, usual) => {
    const input = h("input", { id, type: "checkbox", checked: remembered(id, usual) === "yes" });
    input.addEventListener("change", () => {
      remember(id, input.checked ? "yes" : "no");
      want();
    });
    return [input, h("label", { class: "check", for: id }, input, t(key))];
  };
  const [on, onLabel] = box("camera-on", "camera_on", "yes");
  const [marks, marksLabel] = box("camera-found", "found", "yes");
  const large = h("button", {
    type: "button", "aria-pressed": "false",
    onclick: () => {
      const is = document.body.classList.toggle("large-camera");
      large.setAttribute("aria-pressed", String(is));
    },
  }, t("enlarge"));

  function want() {
    const camera = on.checked && possible && !document.hidden;
    connection.watch({ camera, found: camera && marks.checked });
    if (!on.checked || !possible) {
      image.hidden = true;
      note.hidden = false;
      say(note, possible ? t("camera_off") : t("camera_never"));
    } else if (image.hidden) {
      say(note, t("camera_wait"));
    }
    draw();
  }

  function draw() {
    const [width, height] = [image.naturalWidth || 320, image.naturalHeight || 240];
    if (overlay.width !== width || overlay.height !== height) {
      [overlay.width, overlay.height] = [width, height];
    }
    const ink = overlay.getContext("2d");
    ink.clearRect(0, 0, width, height);
    if (!marks.checked || image.hidden) {
      return;
    }
    ink.font = "600 11px system-ui, sans-serif";
    ink.lineWidth = 2;
    for (const [behaviour, { at, list }] of found) {
      if (Date.now() - at > FRESH) {
        found.delete(behaviour);
        continue;
      }
      for (const { x, y, w, h: high, text: said } of list) {
        const text = visible(said);
        ink.strokeStyle = "#7dff2a";
        ink.strokeRect(x, y, w, high);
        const above = y > 14 ? y - 14 : y + high;
        ink.fillStyle = "rgba(0, 0, 0, 0.65)";
        ink.fillRect(x, above, ink.measureText(text).width + 6, 14);
        ink.fillStyle = "#fff";
        ink.fillText(text, x + 3, above + 11);
      }
    }
  }

  image.addEventListener("load", () => {
    image.hidden = false;
    note.hidden = true;
    draw();
    connection.send({ type: "frame_shown" });
  });
  image.addEventListener("error", () => connection.send({ type: "frame_shown" }));
  function grow() {
    const stale = !image.hidden && !paused && since(came) >= STALE;
    stage.classList.toggle("stale", stale);
    age.hidden = !stale;
    say(age, stale ? t("camera_age", { seconds: Math.floor(since(came) / 1000) }) : "");
    if (stale) {
      say(rate, "");
    }
  }
  connection.on("age", grow);
  connection.on("map", ({ clock }) => { paused = clock?.paused ?? false; });
  connection.on("frame", ({ jpeg }) => {
    came = stamp();
    grow();
    const url = URL.createObjectURL(new Blob([jpeg], { type: "image/jpeg" }));
    const old = shown;
    shown = url;
    image.src = url;
    if (old) {
      // The previous picture may still be being displayed.
      setTimeout(() => URL.revokeObjectURL(old), 1000);
    }
  });
  connection.on("found", ({ behaviour, marks: list }) => {
    found.set(behaviour, { at: Date.now(), list });
    draw();
  });
  connection.on("hello", ({ camera: can }) => {
    possible = can;
    want();
  });
  connection.on("state", ({ fps }) => say(rate, image.hidden || !age.hidden ? "" : t("fps", { fps })));
  document.addEventListener("visibilitychange", want);

  return h("section", { class: "card camera", "aria-labelledby": "camera-title" },
    h("div", { class: "head" }, h("h2", { id: "camera-title" }, t("camera")), rate),
    stage,
    h("div", { class: "row tools" }, onLabel, marksLabel, large));
}
