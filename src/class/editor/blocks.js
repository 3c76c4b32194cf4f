// Blocks for the class page: Blockly, whose keyboard navigation and screen reader support are on by themselves.

import * as Blockly from "blockly/core";
import * as de from "blockly/msg/de";
import * as en from "blockly/msg/en";
import * as it from "blockly/msg/it";
import { generate } from "./generate.js";
import { BLOCKS, GROUPS, LANGUAGES, WORDS } from "./table.js";

export { generate };

const TEXTS = {
  range: ["from {low} to {high}", "von {low} bis {high}", "da {low} a {high}"],
  variable: ["New variable", "Neue Variable", "Nuova variabile"],
};
const EMPTY = { blocks: { languageVersion: 0, blocks: [{ type: "easy_start", x: 24, y: 24 }] } };

const STYLE = `
.blocklyComputeCanvas { display: none; }
.spykee-blocks .blocklyToolbox { padding: 8px 0; border-right: 1px solid var(--line); font-size: 0.9375rem; }
.spykee-blocks .blocklyToolboxCategory { height: auto; min-height: 40px; padding: 8px; line-height: 1.3; }
.spykee-blocks .blocklyToolboxCategoryIcon { display: none; }
.spykee-blocks .blocklyToolboxCategoryLabel { display: inline-block; max-width: 6rem; font: inherit; white-space: normal; }
.spykee-blocks .blocklyHighlighted > .blocklyPath { stroke: var(--lamp); stroke-width: 5px; filter: none; }
.spykee-blocks input.blocklyHtmlInput { min-height: 0; padding: 0; border-radius: 99px; background: #fff; color: #1b2324; }
.spykee-blocks .blocklyWidgetDiv .blocklyMenu { background: var(--card); color: var(--ink); border-color: var(--field); }
.spykee-blocks .blocklyWidgetDiv .blocklyMenuItemContent { color: var(--ink); }
.spykee-blocks .blocklyMenuItemSelected .blocklyMenuItemCheckbox::before { content: "✓"; }
.spykee-blocks .blocklyDropDownDiv .blocklyMenuItem { min-height: 36px; align-content: center; }
.spykee-blocks .blocklyFlyoutLabelText, .spykee-blocks .blocklyFlyoutButton .blocklyText { fill: var(--ink); }
.spykee-blocks .blocklyFlyoutButton .blocklyFlyoutButtonBackground { fill: var(--card); stroke: var(--field); }
`;

/** Blockly makes elements for its styles, which the page's policy forbids: this gives their text to the document. */
function withStyles(work) {
  const adopt = (text) => {
    const sheet = new CSSStyleSheet();
    // There are no pictures beside this module.
    sheet.replaceSync(text.replace(/url\([^)]*\)/g, "none"));
    document.adoptedStyleSheets.push(sheet);
  };
  document.head.prepend = ({ textContent }) => adopt(textContent);
  try {
    return work();
  } finally {
    delete document.head.prepend;
    if (!withStyles.done) {
      adopt(STYLE);
      withStyles.done = true;
    }
  }
}

/** Keeps a number within the range of the input that it is plugged into. */
function limit(block, number) {
  const input = block.outputConnection?.targetConnection?.getParentInput();
  const { low = -Infinity, high = Infinity } = BLOCKS.get(input?.getSourceBlock().type)?.args[Number(input.name.slice(1))] ?? {};
  return Math.min(high, Math.max(low, number));
}

function argument({ type, check, names, usual, low, high, empty, ...rest }, index, text) {
  const options = names?.map((name) => [text(WORDS[name] ?? [name]), name]);
  return { type, name: `A${index}`, check, options, ...rest };
}

function define(text) {
  for (const row of BLOCKS.values()) {
    const ranges = row.args.filter(({ low }) => low !== undefined).map(({ low, high }) => text(TEXTS.range).replace("{low}", low).replace("{high}", high));
    const connections = row.output ? { output: row.output } : row.hat ? { nextStatement: null } : { previousStatement: null, nextStatement: null };
    Blockly.Blocks[row.name] = {
      init() {
        this.jsonInit({
          type: row.name, message0: text(row.texts), args0: row.args.map((arg, index) => argument(arg, index, text)),
          inputsInline: true, style: `easy_${row.group}`, tooltip: ranges.join("; "), ...connections,
        });
        if (row.name === "easy_number") {
          this.getField("A0").setValidator((number) => limit(this, number));
        }
      },
    };
  }
}

function toolbox(text) {
  const block = ({ name, args }) => {
    const usual = args.map((arg, index) => [`A${index}`, arg.usual]).filter(([, shadow]) => shadow);
    return { kind: "block", type: name, inputs: Object.fromEntries(usual.map(([input, shadow]) => [input, { shadow }])) };
  };
  const button = { kind: "button", text: text(TEXTS.variable), callbackkey: "variable" };
  const contents = Object.entries(GROUPS).map(([group, { texts }]) => ({
    kind: "category", name: text(texts), categorystyle: group,
    contents: [...(group === "variables" ? [button] : []), ...[...BLOCKS.values()].filter((row) => row.group === group).map(block)],
  }));
  return { kind: "categoryToolbox", contents };
}

function theme() {
  const groups = Object.entries(GROUPS);
  return Blockly.Theme.defineTheme("spykee", {
    name: "spykee",
    blockStyles: Object.fromEntries(groups.map(([group, { colour }]) => [`easy_${group}`, { colourPrimary: colour, hat: group === "events" ? "cap" : "" }])),
    categoryStyles: Object.fromEntries(groups.map(([group, { colour }]) => [group, { colour }])),
    componentStyles: {
      workspaceBackgroundColour: "var(--paper)", toolboxBackgroundColour: "var(--card)", toolboxForegroundColour: "var(--ink)",
      flyoutBackgroundColour: "var(--line)", flyoutForegroundColour: "var(--ink)", flyoutOpacity: 1, scrollbarColour: "var(--field)",
    },
    fontStyle: { family: "system-ui, sans-serif", weight: "600", size: 12 },
  });
}

/** Makes a workspace of blocks in `parent`. `onChange` gets the state, its Luau, and the block of each line of that. */
export function blocks(parent, { state, onChange = () => {}, readOnly = false }) {
  const language = Math.max(0, LANGUAGES.indexOf(document.documentElement.lang));
  const text = (texts) => texts[language] ?? texts[0];
  Blockly.setLocale([en, de, it][language]);
  define(text);
  const host = document.createElement("div");
  host.className = "spykee-blocks";
  host.style.height = "100%";
  parent.append(host);
  // Keys typed here are no commands of the page. It hears Escape in the capture phase.
  host.addEventListener("keydown", (event) => event.stopPropagation());
  const workspace = withStyles(() => Blockly.inject(host, {
    toolbox: toolbox(text), theme: theme(), renderer: "zelos", readOnly, sounds: false, trashcan: false,
    comments: false, collapse: false, disable: false, maxInstances: { easy_start: 1 },
    move: { scrollbars: true, drag: true, wheel: true }, zoom: { pinch: true, startScale: 0.75 },
  }));
  workspace.registerButtonCallback("variable", () => Blockly.Variables.createVariableButtonHandler(workspace));
  Blockly.serialization.workspaces.load(state ?? EMPTY, workspace);
  const now = () => Blockly.serialization.workspaces.save(workspace);
  let made = { state: now(), ...generate(now()) };
  workspace.addChangeListener(Blockly.Events.disableOrphans);
  workspace.addChangeListener((event) => {
    const done = event.type === Blockly.Events.BLOCK_DRAG || !event.isUiEvent;
    const changed = done && !workspace.isDragging() ? now() : made.state;
    if (JSON.stringify(changed) !== JSON.stringify(made.state)) {
      made = { state: changed, ...generate(changed) };
      onChange(made.state, made.luau, made.blockOfLine);
    }
  });
  host.addEventListener("focusin", ({ target }) => {
    // Blockly gives the fields that one types into no name.
    const node = Blockly.getFocusManager().getFocusedNode();
    if (target.matches("input.blocklyHtmlInput") && node instanceof Blockly.BlockSvg) {
      target.setAttribute("aria-label", (node.getParent() ?? node).toString());
    }
  });
  const size = new ResizeObserver(() => Blockly.svgResize(workspace));
  size.observe(host);
  return {
    element: host,
    get state() {
      return made.state;
    },
    get luau() {
      return made.luau;
    },
    highlight(line) {
      workspace.highlightBlock(made.blockOfLine.get(line) ?? null);
    },
    dispose() {
      size.disconnect();
      workspace.dispose();
      host.remove();
    },
  };
}
