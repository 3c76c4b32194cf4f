// A learner's script: an editor whose text is written to the server while it changes, with marks from the check.

import { h, say } from "/dom.js";
import { t } from "/texts.js";
import { ask, fetchJson } from "./server.js";

/** A changed text is written after this time, milliseconds. */
const SAVE = 500;
const AGAIN = 1000;
const MARKS = 700;

let completions = null;

/** Loads the editor, or else the plain field. */
export async function makeEditor(parent, has, options) {
  completions ??= (await fetchJson("/class/completions.json")).list ?? [];
  const loaded = has ? import("/class/editor.js").catch(() => import("./plain.js")) : import("./plain.js");
  return (await loaded).editor(parent, { completions, ...options });
}

/** The script below a path of the server. `note` shows a sentence to the person. */
export async function script({ base = "/class", has, readOnly = false, label, note = () => {} }) {
  const status = h("span", { class: "quiet saved", role: "status" });
  const element = h("div", { class: "editor" });
  const editor = await makeEditor(element, has, { text: "", readOnly, label, onChange: changed });
  let place = null;
  let version = "";
  let edits = 0;
  let dirty = false;
  let timer = null;
  let writing = null;
  let marking = null;
  let found = [];
  let failure = null;

  const path = (more = "") => `${base}/script?lesson=${encodeURIComponent(place)}${more}`;

  function changed() {
    dirty = true;
    failure = null;
    timer ??= setTimeout(save, SAVE);
    clearTimeout(marking);
    marking = setTimeout(mark, MARKS);
  }

  async function mark() {
    const text = editor.text;
    const answer = await ask("/class/marks", { text, lesson: place });
    if (answer.ok && text === editor.text) {
      found = answer.list ?? [];
      showMarks();
    }
  }

  const showMarks = () => editor.setMarks(failure ? [...found, failure] : found);

  /** Writes what has changed; resolves when all is written, or cannot be. */
  async function save() {
    clearTimeout(timer);
    timer = null;
    await writing;
    if (!dirty || readOnly) {
      return;
    }
    dirty = false;
    say(status, t("saving"));
    writing = write(editor.text);
    await writing;
    writing = null;
  }

  async function write(text) {
    const answer = await ask(path(), { text, version }, { method: "PUT" });
    if (answer.ok) {
      [version, edits] = [answer.version, answer.edits];
      say(status, dirty ? t("saving") : t("saved"));
    } else if (answer.status === 409) {
      show(answer);
      note(t("conflict"));
    } else {
      dirty = true;
      say(status, `${t("not_saved")} ${answer.error ?? ""}`);
      timer ??= setTimeout(save, AGAIN);
    }
  }

  function show(answer) {
    version = answer.version;
    dirty = false;
    editor.setText(answer.text);
    say(status, "");
    mark();
  }

  async function load() {
    const asked = path();
    const answer = await fetchJson(asked);
    if (answer.ok && !dirty && asked === path()) {
      show(answer);
    }
  }

  // A page that is closed or hidden loses nothing.
  document.addEventListener("visibilitychange", () => document.hidden && save());
  window.addEventListener("pagehide", () => dirty && !readOnly && ask(path(), { text: editor.text, version }, { method: "PUT", keepalive: true }));

  return {
    element, status, editor, save,
    get place() { return place; },
    /** Opens the script of a lesson, after writing the one before; stays there if that cannot be written. */
    async open(next, nextBase = base) {
      await save();
      if (dirty) {
        return;
      }
      [place, base, found, failure] = [next, nextBase, [], null];
      await load();
    },
    /** Fetches the text again if somebody else has changed it. */
    follow(now) {
      if (now > edits && !dirty && !writing && place) {
        edits = now;
        load();
      }
    },
    /** A text that something else than the editor has made. */
    replace(text) {
      if (text !== editor.text) {
        editor.setText(text);
        changed();
      }
    },
    /** Marks the line of an error of the run. */
    fail(error) {
      const line = Number(/\.lua:(\d+)/.exec(error ?? "")?.[1] ?? 0);
      failure = line > 0 ? { line, column: 1, end_column: 200, message: error, help: "", severity: "error" } : null;
      showMarks();
    },
  };
}
