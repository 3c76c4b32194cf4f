// A plain text field with line numbers, where the editor is not installed: the same interface.

import { h, say } from "/dom.js";
import { t } from "/texts.js";

const INDENT = "\t";

/** Makes the field in `parent`. Tab indents; after Escape it leaves the field, as everywhere else. */
export function editor(parent, { text = "", readOnly = false, label, onChange = () => {} }) {
  const numbers = h("div", { class: "numbers", "aria-hidden": "true" });
  const hint = h("p", { class: "quiet", id: "plain-hint" }, t("plain_hint"));
  const list = h("ol", { class: "marks", "aria-live": "polite" });
  const field = h("textarea", {
    "aria-label": label, "aria-describedby": "plain-hint", readonly: readOnly, spellcheck: "false", autocapitalize: "off",
    autocomplete: "off", wrap: "off",
  });
  field.value = text;
  const element = h("div", { class: "plain" }, h("div", { class: "sheet" }, numbers, field), list, hint);
  parent.append(element);
  let marked = new Map();
  let leaves = false;

  function count() {
    const lines = field.value.split("\n").length;
    if (numbers.childElementCount !== lines) {
      numbers.replaceChildren(...Array.from({ length: lines }, (_, at) => h("div", {}, String(at + 1))));
    }
    [...numbers.children].forEach((one, at) => { one.className = marked.get(at + 1) ?? ""; });
    numbers.scrollTop = field.scrollTop;
  }

  field.addEventListener("input", () => {
    count();
    onChange(field.value);
  });
  field.addEventListener("scroll", () => { numbers.scrollTop = field.scrollTop; });
  field.addEventListener("keydown", (event) => {
    if (event.key === "Tab" && !leaves && !event.shiftKey && !readOnly) {
      event.preventDefault();
      field.setRangeText(INDENT, field.selectionStart, field.selectionEnd, "end");
      field.dispatchEvent(new Event("input"));
    }
    leaves = event.key === "Escape";
  });

  function showLine(line) {
    const lines = field.value.split("\n");
    const at = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    field.focus();
    field.setSelectionRange(at, at + (lines[line - 1]?.length ?? 0));
    field.scrollTop = Math.max(0, (line - 5) * field.scrollHeight / lines.length);
  }

  function setMarks(marks) {
    marked = new Map(marks.map(({ line, severity }) => [line, severity === "warning" ? "warn" : "bad"]));
    list.replaceChildren(...marks.map(({ line, message, help }) => h("li", {},
      h("button", { type: "button", class: "link", onclick: () => showLine(line) }, t("line", { line })),
      h("span", {}, ` ${message}${help ? `: ${help}` : ""}`))));
    count();
  }

  count();
  return {
    get text() { return field.value; },
    setText(next) {
      field.value = next;
      count();
    },
    setMarks, showLine, element,
    highlightLine(line) {
      marked.forEach((kind, at) => kind === "now" && marked.delete(at));
      if (line) {
        marked.set(line, "now");
      }
      count();
    },
    focus: () => field.focus(),
    say: (words) => say(hint, words),
  };
}
