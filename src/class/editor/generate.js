// From the state of the blocks, as Blockly saves it, to Luau that people can read. Needs neither Blockly nor a browser.

import { BLOCKS } from "./table.js";

/** How strongly operators bind. */
const ORDER = { or: 1, and: 2, "==": 3, "~=": 3, "<": 3, ">": 3, "<=": 3, ">=": 3, "+": 5, "-": 5, "*": 6, "/": 6 };
const ATOM = 9;
const TAKEN = ("and break continue do else elseif end export false for function if in local nil not or repeat return then true type until while "
  + "easy math print robot thing").split(" ");
const PAUSE = "easy.wait(0.1)";

/** Names of Luau for the names that people gave their variables: each its own. */
function luauNames(variables) {
  const names = new Map();
  const taken = new Set(TAKEN);
  for (const { id, name } of variables) {
    const plain = name.normalize("NFD").replace(/\p{M}/gu, "").replace(/ß/g, "ss").replace(/\W+/g, "_").replace(/^(?=\d)/, "_");
    const base = /[A-Za-z0-9]/.test(plain) ? plain : "value";
    let free = base;
    for (let number = 2; taken.has(free); number += 1) {
      free = `${base}${number}`;
    }
    taken.add(free);
    names.set(id, free);
  }
  return names;
}

/** A string of Luau. */
const quoted = (text) => JSON.stringify(text).replace(/(?<!\\)((?:\\\\)*)\\u([\da-f]{4})/g, "$1\\u{$2}");

class Writer {
  lines = [];
  #nested = 0;

  constructor(variables) {
    this.names = luauNames(variables);
    const own = new Set(this.names.values());
    this.counter = ["count", "round", "step"].find((name) => !own.has(name)) ?? "step_";
  }

  #argument(block, index, needs) {
    const [row, name] = [BLOCKS.get(block.type), `A${index}`];
    const field = block.fields?.[name];
    switch (row.args[index].type) {
      case "field_variable": return this.names.get(field.id);
      case "field_input": return quoted(String(field));
      case "field_number": return String(Number(field));
      case "field_dropdown": return row.args[index].names.includes(field) ? field : row.args[index].names[0];
      default: return this.#value(block.inputs?.[name], needs, row.args[index].empty);
    }
  }

  #value(input, needs, empty) {
    const block = input?.block ?? input?.shadow;
    if (!block) {
      return empty;
    }
    const row = BLOCKS.get(block.type);
    const code = this.#fill(row.code, block);
    return (this.#order(block) ?? ATOM) < needs ? `(${code})` : code;
  }

  #order(block) {
    const { order } = BLOCKS.get(block.type);
    return typeof order === "string" ? ORDER[block.fields[order]] : order;
  }

  #fill(template, block) {
    const order = this.#order(block) ?? 0;
    const counter = this.#nested > 1 ? `${this.counter}${this.#nested}` : this.counter;
    return template.replace("{count}", counter).replace(/\{(\d)\}/g, (_, index) => this.#argument(block, Number(index), index === "0" ? order : order + 0.5));
  }

  #line(depth, code, block) {
    this.lines.push({ code: `${"\t".repeat(depth)}${code}`, id: block?.id });
  }

  /** Writes a block's lines, and those of the blocks in it. */
  block(block, depth) {
    const row = BLOCKS.get(block.type);
    const counts = Number(row.code.includes("{count}"));
    this.#nested += counts;
    for (const line of row.code.split("\n")) {
      const index = /^\{(\d)\}$/.exec(line)?.[1];
      if (line === "{next}") {
        this.chain(block.next?.block, depth + Number(row.code !== line));
      } else if (index && row.args[index].type === "input_statement") {
        const waits = this.chain(block.inputs?.[`A${index}`]?.block, depth + 1);
        if (row.pauses && !waits) {
          this.#line(depth + 1, PAUSE, block);
        }
      } else {
        this.#line(depth, this.#fill(line, block), block);
      }
    }
    this.#nested -= counts;
  }

  /** Writes a block and what follows it. Returns whether one of them waits. */
  chain(block, depth) {
    let waits = false;
    for (let one = block; one; one = one.next?.block) {
      this.block(one, depth);
      waits ||= Boolean(BLOCKS.get(one.type).waits);
    }
    return waits;
  }
}

/** The Luau of a state, and the block of each of its lines: `{luau, blockOfLine}`. Stacks without a beginning do nothing. */
export function generate({ blocks = {}, variables = [] } = {}) {
  const writer = new Writer(variables);
  const hats = (blocks.blocks ?? []).filter(({ type }) => BLOCKS.get(type)?.hat).sort((one, other) => (one.y ?? 0) - (other.y ?? 0));
  const parts = [hats.filter(({ type }) => type !== "easy_start"), hats.filter(({ type }) => type === "easy_start")].flat().map((hat) => {
    writer.lines = [];
    writer.block(hat, 0);
    return writer.lines;
  });
  const declared = [...writer.names.values()].map((name) => ({ code: `local ${name} = 0` }));
  if (parts.flat().some(({ code }) => /\bthing\b/.test(code))) {
    declared.unshift({ code: "local thing = nil -- what easy.see saw last" });
  }
  const all = [[{ code: "local easy = require(\"@spykee/easy\")" }], declared, ...parts].filter((part) => part.length > 0);
  const lines = all.flatMap((part, index) => (index > 0 ? [{ code: "" }, ...part] : part));
  const blockOfLine = new Map(lines.map(({ id }, index) => [index + 1, id]).filter(([, id]) => id));
  return { luau: `${lines.map(({ code }) => code).join("\n")}\n`, blockOfLine };
}
