// The text editor of the class page: CodeMirror 6 with completion from the table of the API and the marks of `check`.
// It lives in a shadow root, where its styles need no exception from the page's policy, and no style of the page
// changes it. It takes its colours from the page's variables.

import { autocompletion, closeBrackets, closeBracketsKeymap, completionKeymap } from "@codemirror/autocomplete";
import { defaultKeymap, history, historyKeymap, indentWithTab } from "@codemirror/commands";
import { bracketMatching, HighlightStyle, indentOnInput, indentUnit, syntaxHighlighting } from "@codemirror/language";
import { forEachDiagnostic, lintGutter, lintKeymap, setDiagnostics } from "@codemirror/lint";
import { Annotation, EditorState, StateEffect, StateField } from "@codemirror/state";
import {
  Decoration, drawSelection, EditorView, highlightActiveLine, highlightActiveLineGutter, keymap, lineNumbers, showPanel,
} from "@codemirror/view";
import { tags } from "@lezer/highlight";
import { complete } from "./completion.js";
import { luau } from "./luau.js";

const LANGUAGES = ["en", "de", "it"];
const TEXTS = {
  keys: [
    "Tab indents. To leave the editor by keyboard: Escape, then Tab. F8 goes to the next mistake.",
    "Tab rückt ein. Mit der Tastatur aus dem Editor: Escape, dann Tab. F8 geht zum nächsten Fehler.",
    "Tab fa rientrare. Per uscire con la tastiera: Esc, poi Tab. F8 va al prossimo errore.",
  ],
  line: ["Line", "Zeile", "Riga"],
  mistakes: ["Mistakes", "Fehler", "Errori"],
};
const text = (key) => TEXTS[key][Math.max(0, LANGUAGES.indexOf(document.documentElement.lang))];

const theme = EditorView.theme({
  "&": { height: "100%", background: "var(--card)", color: "var(--ink)", fontSize: "16px" },
  "&.cm-focused": { outline: "3px solid var(--accent)", outlineOffset: "0" },
  ".cm-scroller": { overflow: "auto", lineHeight: "1.55", fontFamily: "ui-monospace, \"DejaVu Sans Mono\", Consolas, monospace" },
  ".cm-content": { caretColor: "var(--ink)", padding: "8px 0" },
  ".cm-content, .cm-gutter": { minHeight: "18rem" },
  ".cm-cursor": { borderLeft: "2px solid var(--ink)" },
  "&.cm-focused > .cm-scroller > .cm-selectionLayer .cm-selectionBackground, .cm-selectionBackground": { background: "var(--grid)" },
  ".cm-gutters": { background: "var(--paper)", color: "var(--quiet)", borderColor: "var(--line)" },
  ".cm-activeLine, .cm-activeLineGutter": { background: "var(--accent-soft)" },
  ".cm-activeLine": { background: "color-mix(in srgb, var(--accent-soft) 45%, transparent)" },
  ".cm-running": { background: "color-mix(in srgb, var(--lamp) 18%, transparent)", boxShadow: "inset 4px 0 var(--lamp)" },
  "&.cm-focused .cm-matchingBracket, .cm-matchingBracket": { background: "none", outline: "1px solid var(--accent)" },
  "&.cm-focused .cm-nonmatchingBracket": { background: "var(--danger-soft)", color: "var(--danger)" },
  ".cm-panels, .cm-tooltip": { background: "var(--card)", color: "var(--ink)", borderColor: "var(--line)" },
  ".cm-tooltip": { border: "1px solid var(--field)", borderRadius: "8px", maxWidth: "min(92vw, 34rem)" },
  ".cm-tooltip.cm-tooltip-autocomplete > ul": { fontFamily: "inherit", maxHeight: "14rem" },
  ".cm-tooltip.cm-tooltip-autocomplete > ul > li": { padding: "6px 12px" },
  ".cm-tooltip.cm-tooltip-autocomplete > ul > li[aria-selected]": { background: "var(--accent)", color: "var(--on-accent)" },
  ".cm-completionInfo": { padding: "8px 12px", width: "max-content", font: "0.9375rem/1.5 system-ui, sans-serif" },
  ".cm-signature": { display: "block", fontFamily: "ui-monospace, monospace", color: "var(--accent)", overflowWrap: "anywhere" },
  ".cm-diagnostic": { padding: "8px 12px", font: "0.9375rem/1.5 system-ui, sans-serif" },
  ".cm-help": { display: "block", color: "var(--quiet)" },
  ".cm-status": { padding: "4px 12px", borderTop: "1px solid var(--line)", color: "var(--quiet)", font: "0.875rem/1.5 system-ui, sans-serif" },
  ".cm-status.cm-bad": { color: "var(--ink)", boxShadow: "inset 4px 0 var(--danger)" },
});

const colours = syntaxHighlighting(HighlightStyle.define([
  { tag: tags.keyword, color: "light-dark(#7a3e9d, #d3a4f0)", fontWeight: "600" },
  { tag: [tags.atom, tags.number], color: "light-dark(#98420a, #f0a878)" },
  { tag: tags.string, color: "light-dark(#356a16, #a5d37f)" },
  { tag: tags.comment, color: "var(--quiet)", fontStyle: "italic" },
  { tag: tags.function(tags.variableName), color: "light-dark(#0b5f8a, #7cc7ee)" },
]));

/** The line that runs. */
const setRunning = StateEffect.define();
const running = StateField.define({
  create: () => Decoration.none,
  update(old, { changes, effects, newDoc }) {
    const line = effects.find((effect) => effect.is(setRunning))?.value;
    if (line === undefined) {
      return old.map(changes);
    }
    const there = line !== null && line >= 1 && line <= newDoc.lines;
    return there ? Decoration.set(Decoration.line({ class: "cm-running" }).range(newDoc.line(line).from)) : Decoration.none;
  },
  provide: (field) => EditorView.decorations.from(field),
});

/** A change by the page, not by the person. */
const byPage = Annotation.define();

function element(name, className, content) {
  const made = document.createElement(name);
  made.className = className;
  made.textContent = content;
  return made;
}

/** The one change from a text to another: what is before and behind it, cursors too, stays. */
function difference(old, changed) {
  const most = Math.min(old.length, changed.length);
  let from = 0;
  while (from < most && old[from] === changed[from]) {
    from += 1;
  }
  let behind = 0;
  while (behind < most - from && old.at(-1 - behind) === changed.at(-1 - behind)) {
    behind += 1;
  }
  return { from, to: old.length - behind, insert: changed.slice(from, changed.length - behind) };
}

/** A place in a line, whose columns count characters from 1. */
function position(doc, line, column) {
  const { from, text: code } = doc.line(Math.min(Math.max(line, 1), doc.lines));
  return from + [...code].slice(0, Math.max(column, 1) - 1).join("").length;
}

function diagnostic(doc, { line, column, end_column: end, message, help, severity = "error" }) {
  const from = position(doc, line, column);
  const renderMessage = () => {
    const shown = element("span", "", message);
    shown.append(element("span", "cm-help", help ?? ""));
    return shown;
  };
  return { from, to: Math.max(from, position(doc, line, end ?? column + 1)), severity, message, help, renderMessage };
}

/** The mistake in the cursor's line in words, for touch and for screen readers; otherwise how many there are. */
function status(view) {
  const dom = element("div", "cm-status", "");
  dom.setAttribute("role", "status");
  const update = ({ state }) => {
    const [all, here] = [[], state.doc.lineAt(state.selection.main.head)];
    forEachDiagnostic(state, (one, from) => all.push({ ...one, from }));
    const mark = all.find(({ from }) => from >= here.from && from <= here.to);
    const sentence = mark ? `${text("line")} ${here.number}: ${[mark.message, mark.help].filter(Boolean).join(" – ")}`
      : all.length > 0 ? `${text("mistakes")}: ${all.length}. ${text("keys")}` : text("keys");
    dom.classList.toggle("cm-bad", Boolean(mark));
    if (dom.textContent !== sentence) {
      dom.textContent = sentence;
    }
  };
  update(view);
  return { dom, update };
}

/** Makes an editor in `parent`: see the calls that it returns. */
export function editor(parent, { text: first = "", readOnly = false, label = "", onChange = () => {}, completions = [] }) {
  const host = document.createElement("div");
  host.className = "spykee-editor";
  host.style.height = "100%";
  parent.append(host);
  const root = host.attachShadow({ mode: "open" });
  // Keys typed here are no commands of the page. It hears Escape in the capture phase.
  host.addEventListener("keydown", (event) => event.stopPropagation());
  const view = new EditorView({
    root,
    parent: root,
    state: EditorState.create({
      doc: first,
      extensions: [
        luau, theme, colours, running, history(), lineNumbers(), drawSelection(), indentUnit.of("\t"), EditorState.tabSize.of(4),
        indentOnInput(), bracketMatching(), EditorView.lineWrapping, closeBrackets(), lintGutter(), highlightActiveLine(), highlightActiveLineGutter(),
        autocompletion({ override: [complete(completions)], icons: false }),
        keymap.of([...closeBracketsKeymap, ...completionKeymap, ...lintKeymap, ...defaultKeymap, ...historyKeymap, indentWithTab]),
        showPanel.of(status), EditorState.readOnly.of(readOnly),
        EditorView.contentAttributes.of({ tabindex: "0", "aria-label": label, "aria-description": text("keys"), "aria-readonly": String(readOnly) }),
        EditorView.updateListener.of(({ docChanged, state, transactions }) => {
          if (docChanged && !transactions.some((one) => one.annotation(byPage))) {
            onChange(state.doc.toString());
          }
        }),
      ],
    }),
  });
  return {
    element: host,
    get text() {
      return view.state.doc.toString();
    },
    setText(changed) {
      view.dispatch({ changes: difference(view.state.doc.toString(), changed), annotations: byPage.of(true) });
    },
    setMarks(marks) {
      view.dispatch(setDiagnostics(view.state, marks.map((mark) => diagnostic(view.state.doc, mark))));
    },
    showLine(line) {
      const at = position(view.state.doc, line, 1);
      view.dispatch({ selection: { anchor: at }, effects: EditorView.scrollIntoView(at, { y: "center" }) });
      view.focus();
    },
    highlightLine(line) {
      view.dispatch({ effects: setRunning.of(line) });
    },
    focus() {
      view.focus();
    },
  };
}
