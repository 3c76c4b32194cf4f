// Shows a script's text, with one line marked.

import { FETCH_LIMIT, h, say } from "./dom.js";
import { t } from "./texts.js";

const title = h("h2", { id: "script-title" });
const note = h("p", { class: "quiet" });
const code = h("ol", { class: "code", tabindex: 0, "aria-labelledby": "script-title" });
const close = h("button", { type: "button", onclick: closeScript }, t("close"));
const dialog = h("dialog", { class: "script", "aria-labelledby": "script-title" },
  h("div", { class: "head" }, title, close), note, code);
document.body.append(dialog);

/** Closes it. Returns whether it was open. */
export function closeScript() {
  const was = dialog.open;
  dialog.close();
  return was;
}

/** Shows a behaviour's script and marks a line. */
export async function showScript(name, line) {
  const answer = await fetch(`/api/behaviours/${encodeURIComponent(name)}/script`, { signal: AbortSignal.timeout(FETCH_LIMIT) });
  const script = answer.ok ? await answer.json() : { file: name, text: "", changed: false };
  say(title, script.file);
  say(note, answer.ok ? (script.changed ? t("script_changed") : "") : t("script_gone"));
  note.hidden = note.textContent === "";
  const rows = script.text.replace(/\n$/, "").split("\n").map((text, index) => {
    const marked = index + 1 === line;
    return h("li", { class: marked && "marked", "aria-current": marked && "true" }, h("code", {}, text || " "));
  });
  code.replaceChildren(...rows);
  // Not a modal one: nothing may cover STOP, or make it inert.
  dialog.show();
  const marked = code.querySelector(".marked");
  (marked ?? code).scrollIntoView({ block: marked ? "center" : "start" });
}
