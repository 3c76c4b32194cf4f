// The text of a lesson: the Markdown that our lessons use, as elements. HTML is never parsed.

import { h } from "/dom.js";

const INLINE = /`([^`]+)`|\*\*([^*]+)\*\*|\[([^\]]+)\]\([^)]*\)/g;

function inline(text) {
  const parts = [];
  let from = 0;
  for (const match of text.matchAll(INLINE)) {
    parts.push(text.slice(from, match.index));
    const [whole, code, strong, link] = match;
    parts.push(code ? h("code", {}, code) : strong ? h("strong", {}, strong) : link);
    from = match.index + whole.length;
  }
  return [...parts, text.slice(from)].filter((part) => part !== "");
}

function block(lines) {
  const [first] = lines;
  if (lines.every((line) => line.startsWith("    "))) {
    // What to type in a terminal has a button here.
    const code = lines.map((line) => line.slice(4));
    return code.every((line) => line.startsWith("spykee ")) ? null : h("pre", {}, h("code", {}, code.join("\n")));
  }
  if (first.startsWith("#")) {
    return h("h3", {}, ...inline(first.replace(/^#+ */, "")));
  }
  if (/^([-*]|\d+\.) /.test(first)) {
    const items = lines.join("\n").split(/\n(?=(?:[-*]|\d+\.) )/);
    const item = (one) => h("li", {}, ...inline(one.replace(/^([-*]|\d+\.) /, "").replaceAll("\n", " ")));
    return h(/^\d/.test(first) ? "ol" : "ul", {}, ...items.map(item));
  }
  return h("p", {}, ...inline(lines.join(" ")));
}

/** Returns elements for a text. */
export function markdown(text) {
  const top = [];
  let details = null;
  let lines = [];
  let fence = false;
  const end = () => {
    const made = lines.length > 0 ? (fence ? h("pre", {}, h("code", {}, lines.join("\n"))) : block(lines)) : null;
    if (made) {
      (details ?? { append: (one) => top.push(one) }).append(made);
    } else if (lines.length > 0 && top.at(-1)?.textContent.endsWith(":")) {
      // The sentence that introduces it.
      top.pop();
    }
    lines = [];
  };
  for (const line of text.split("\n").slice(1)) {
    const summary = /^<details><summary>(.*)<\/summary>$/.exec(line);
    if (line.startsWith("```")) {
      end();
      fence = !fence;
    } else if (fence) {
      lines.push(line);
    } else if (summary) {
      end();
      details = h("details", {}, h("summary", {}, summary[1]));
      top.push(details);
    } else if (line === "</details>") {
      end();
      details = null;
    } else if (line === "") {
      end();
    } else {
      lines.push(line);
    }
  }
  end();
  return top;
}
