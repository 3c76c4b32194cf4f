// The behaviours of the run: what each does, and starting and ending them.

import { clock, h, say } from "./dom.js";
import { showScript } from "./script.js";
import { t } from "./texts.js";

/** One of them; made once and then changed, so that the keyboard's place stays. */
function entry(name, order) {
  const dot = h("span", { class: "dot", "aria-hidden": "true" });
  const state = h("span", { class: "quiet" });
  const button = (key, change) => h("button", {
    type: "button", "aria-label": t("of", { action: t(key), name }),
    onclick: () => order({ do: "behaviour", name, change }),
  }, t(key));
  const buttons = { start: button("start", "start"), stop: button("end", "stop"), restart: button("restart", "restart") };
  const script = h("button", {
    type: "button", class: "link", "aria-label": t("of", { action: t("show_script"), name }),
    onclick: () => showScript(name, null),
  }, t("show_script"));
  const params = h("p", { class: "quiet params" });
  const trouble = h("p", { class: "trouble" });
  let told = "";

  const element = h("li", {},
    h("div", { class: "head" }, dot, h("strong", {}, name), state),
    params, trouble,
    h("div", { class: "row" },
      h("span", { class: "row driver-only" }, buttons.start, buttons.stop, buttons.restart), script));

  function update(one) {
    dot.className = `dot ${one.state}`;
    const since = one.running === null ? "" : ` ${clock(one.running)}`;
    const priority = one.priority === 0 ? "" : ` · ${t("priority", { number: one.priority })}`;
    say(state, `${t(`state_${one.state}`)}${since}${priority}`);
    const running = one.state === "running" || one.state === "loading";
    buttons.start.hidden = running;
    buttons.stop.hidden = !running;
    buttons.restart.hidden = !running;
    script.hidden = one.file === null;
    say(params, one.params.map(([key, value]) => `${key} = ${value}`).join(", "));
    const key = JSON.stringify(one.ending);
    if (key !== told) {
      told = key;
      explain(one.ending);
    }
  }

  function explain(ending) {
    if (!ending) {
      return trouble.replaceChildren();
    }
    const bad = !["done", "cancelled", "reload", "shutdown"].includes(ending.reason);
    trouble.className = bad ? "trouble" : "quiet";
    const text = bad ? ending.text : t("ended", { reason: ending.reason });
    const line = ending.line && bad ? h("button", {
      type: "button", class: "link", onclick: () => showScript(name, ending.line),
    }, t("show_line", { line: ending.line, name })) : null;
    trouble.replaceChildren(text, ...(line ? [" ", line] : []));
  }

  return { element, update };
}

export function behaviours(connection, order) {
  const list = h("ul", { class: "behaviours" });
  const empty = h("p", { class: "quiet" }, t("no_behaviours"));
  const entries = new Map();
  connection.on("behaviours", ({ list: all }) => {
    empty.hidden = all.length > 0;
    for (const one of all) {
      if (!entries.has(one.name)) {
        entries.set(one.name, entry(one.name, order));
        list.append(entries.get(one.name).element);
      }
      entries.get(one.name).update(one);
    }
    for (const [name, { element }] of entries) {
      if (!all.some((one) => one.name === name)) {
        element.remove();
        entries.delete(name);
      }
    }
  });
  return h("section", { class: "card behaviours-card", "aria-labelledby": "behaviours-title" },
    h("h2", { id: "behaviours-title" }, t("behaviours")), empty, list);
}
