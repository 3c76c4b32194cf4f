// Shows one of several pictures, with its neighbours a tap away.

import { h, say } from "./dom.js";
import { t } from "./texts.js";

const image = h("img", { alt: "" });
const caption = h("p", { id: "photo-title" });
const close = h("button", { type: "button", onclick: closePhoto }, t("close"));
const back = h("button", { type: "button", onclick: () => show(at - 1) }, t("previous"));
const next = h("button", { type: "button", onclick: () => show(at + 1) }, t("next"));
const dialog = h("dialog", { class: "script photo", "aria-labelledby": "photo-title" },
  h("div", { class: "head" }, caption, close), image, h("div", { class: "row" }, back, next));
document.body.append(dialog);
let list = [];
let at = 0;

function show(index) {
  at = index;
  const { src, text } = list[at];
  image.src = src;
  say(caption, text);
  back.disabled = at === 0;
  next.disabled = at === list.length - 1;
}

/** Closes it. Returns whether it was open. */
export function closePhoto() {
  const was = dialog.open;
  dialog.close();
  return was;
}

/** Shows a picture of a list of `{ src, text }`. */
export function showPhoto(photos, index) {
  list = photos;
  show(index);
  // Not a modal one: nothing may cover STOP, or make it inert.
  dialog.show();
}
