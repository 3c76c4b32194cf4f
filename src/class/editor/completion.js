// Completion from the table of the API: `[{name, kind, signature, doc}]`, such as `robot.move` or the event `noise`.

import { insertCompletionText, pickedCompletion } from "@codemirror/autocomplete";
import { syntaxTree } from "@codemirror/language";
import { KEYWORDS } from "./luau.js";

/** Signature and description; the texts stay text. */
function info({ signature, doc }) {
  const shown = document.createElement("div");
  const code = document.createElement("code");
  code.className = "cm-signature";
  code.textContent = signature ?? "";
  shown.append(code, doc ?? "");
  return shown;
}

/** Inserts a function with its parentheses, the cursor between them if it takes something. */
function call(key, { signature }) {
  return (view, completion, from, to) => {
    const called = view.state.sliceDoc(to, to + 1) === "(";
    view.dispatch({ ...insertCompletionText(view.state, called ? key : `${key}()`, from, to), annotations: pickedCompletion.of(completion) });
    if (!called) {
      const inside = /\(\s*\)/.test(signature) ? 2 : 1;
      view.dispatch({ selection: { anchor: from + key.length + inside } });
    }
  };
}

function option(entry, key) {
  const callable = entry.signature?.includes("(") && entry.kind !== "event";
  return { label: key, info: () => info(entry), apply: callable ? call(key, entry) : undefined, type: entry.kind };
}

/** The local names of modules: `local easy = require("@spykee/easy")`. */
function aliases(code) {
  const found = code.matchAll(/\blocal\s+(\w+)\s*=\s*require\s*\(?\s*["']@spykee\/(\w+)["']/g);
  return Object.fromEntries([...found].map(([, alias, module]) => [alias, module]));
}

/** What is before the cursor, and what fits there: in strings, and elsewhere. */
const PLACES = {
  string: [[/\brobot\.(?:on|once|wait_for)\s*\(\s*["'](\w*)$/, (entries) => entries.filter(({ kind }) => kind === "event").map((one) => option(one, one.name))]],
  comment: [],
  code: [
    [/\b(\w+)\.(\w*)$/, (entries, code, owner) => {
      const prefix = `${aliases(code)[owner] ?? owner}.`;
      return entries.filter(({ name }) => name.startsWith(prefix)).map((one) => option(one, one.name.slice(prefix.length)));
    }],
    [/:(\w*)$/, (entries) => entries.filter(({ name }) => name.includes(":")).map((one) => option(one, one.name.split(":")[1]))],
    [/(?<![.\w])([A-Za-z_]\w+)$/, (entries, code, typed) => {
      const globals = entries.filter(({ name, kind }) => !/[.:]/.test(name) && kind !== "event");
      const spaces = entries.map(({ name }) => name.split(".")).filter((parts) => parts.length > 1).map(([space]) => space);
      const own = [...code.matchAll(/[A-Za-z_]\w+/g)].map(([word]) => word).filter((word) => word !== typed);
      const words = new Set([...KEYWORDS, "true", "false", "nil", "print", "robot", ...own, ...spaces]);
      globals.forEach(({ name }) => words.delete(name));
      return [...globals.map((one) => option(one, one.name)), ...[...words].map((label) => ({ label }))];
    }],
  ],
};

/** A source of completions for CodeMirror. */
export function complete(entries) {
  return (context) => {
    const line = context.state.doc.lineAt(context.pos);
    const before = line.text.slice(0, context.pos - line.from);
    const places = PLACES[syntaxTree(context.state).resolveInner(context.pos, -1).name] ?? PLACES.code;
    const [where, find] = places.find(([pattern]) => pattern.test(before)) ?? [];
    if (!where) {
      return null;
    }
    const groups = where.exec(before).slice(1);
    const options = find(entries, context.state.doc.toString(), groups[0]);
    const typed = groups.at(-1) ?? "";
    // Enter after a whole word is a new line.
    const whole = (word) => options.some(({ label }) => label === word);
    return whole(typed) || options.length === 0 ? null
      : { from: context.pos - typed.length, options, validFor: (word) => /^\w*$/.test(word) && !whole(word) };
  };
}
