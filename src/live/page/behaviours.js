// The behaviours of the run: their state, and buttons to start and end them.

import { clock, h, say, visible } from "./dom.js";
import { showScript } from "./script.js";
import { t } from "./texts.js";

/** A parameter: an input if it is live, otherwise its value. Not updated while the user edits it. */
function paramControl(behaviour, { name, value, live, min, max, unit, choices, doc }, command) {
  const words = (now) => `${now}${unit ? ` ${unit}` : ""}`;
  const id = `param-${behaviour}-${name}`;
  const label = h("label", { for: id, title: doc || null }, name);
  const shown = h("output", { for: id });
  const set = (next) => command({ do: "param", name: behaviour, param: name, value: next });
  let input = null;
  if (live && typeof value === "boolean") {
    input = h("input", { id, type: "checkbox", onchange: () => set(input.checked) });
  } else if (live && typeof value === "number") {
    const both = min !== null && max !== null;
    const step = both && Number.isInteger(min) && Number.isInteger(max) && max - min >= 5 ? 1 : "any";
    input = h("input", { id, type: both ? "range" : "number", min, max, step, onchange: () => input.value !== "" && set(Number(input.value)), oninput: () => say(shown, words(input.value)) });
  } else if (live && choices.length > 0) {
    input = h("select", { id, onchange: () => set(input.value) }, ...choices.map((one) => h("option", {}, one)));
  } else if (live) {
    input = h("input", { id, type: "text", maxlength: 200, onchange: () => set(input.value) });
  }
  function update(now) {
    if (input === null || input.type === "range") {
      say(shown, words(now));
    }
    if (input !== null && document.activeElement !== input) {
      if (input.type === "checkbox") {
        input.checked = now;
      } else {
        input.value = String(now);
      }
    }
  }
  update(value);
  const hand = input === null ? null : h("span", { class: "driver-only hand" }, input);
  return { element: h("div", { class: "param-row" }, label, hand, shown), update };
}

/** One behaviour; created once and then updated, so that the keyboard focus is kept. */
function entry(name, command) {
  const dot = h("span", { class: "dot", "aria-hidden": "true" });
  const state = h("span", { class: "quiet" });
  const button = (key, change) => h("button", {
    type: "button", "aria-label": t("of", { action: t(key), name }),
    onclick: () => command({ do: "behaviour", name, change }),
  }, t(key));
  const buttons = { start: button("start", "start"), stop: button("end", "stop"), restart: button("restart", "restart") };
  const script = h("button", {
    type: "button", class: "link", "aria-label": t("of", { action: t("show_script"), name }),
    onclick: () => showScript(name, null),
  }, t("show_script"));
  const params = h("p", { class: "quiet params" });
  const paramList = h("div", { class: "param-list" });
  const turns = new Map();
  let declared = "";
  const trouble = h("p", { class: "trouble" });
  let told = "";

  const element = h("li", {},
    h("div", { class: "head" }, dot, h("strong", {}, name), state),
    params, paramList, trouble,
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
    tune(one.declared_params);
    say(params, one.declared_params.length > 0 ? "" : one.params.map(([key, value]) => `${key} = ${value}`).join(", "));
    const key = JSON.stringify(one.exit);
    if (key !== told) {
      told = key;
      explain(one.exit);
    }
  }

  function tune(list) {
    // Rebuilt only if the declarations have changed, so that an input in use is kept.
    const shape = JSON.stringify(list.map((one) => ({ ...one, value: typeof one.value })));
    if (shape !== declared) {
      declared = shape;
      turns.clear();
      list.forEach((one) => turns.set(one.name, paramControl(name, one, command)));
      paramList.replaceChildren(...[...turns.values()].map(({ element }) => element));
    }
    list.forEach((one) => turns.get(one.name).update(one.value));
  }

  function explain(exit) {
    if (!exit) {
      return trouble.replaceChildren();
    }
    const bad = !["done", "cancelled", "reload", "shutdown"].includes(exit.reason);
    trouble.className = bad ? "trouble" : "quiet";
    const text = bad ? exit.text : t("ended", { reason: exit.reason });
    const line = exit.line && bad ? h("button", {
      type: "button", class: "link", onclick: () => showScript(name, exit.line),
    }, t("show_line", { line: exit.line, name })) : null;
    trouble.replaceChildren(visible(text), ...(line ? [" ", line] : []));
  }

  return { element, update };
}

export function behaviours(connection, command) {
  const list = h("ul", { class: "behaviours" });
  const empty = h("p", { class: "quiet" }, t("no_behaviours"));
  const entries = new Map();
  connection.on("behaviours", ({ list: all }) => {
    empty.hidden = all.length > 0;
    for (const one of all) {
      if (!entries.has(one.name)) {
        entries.set(one.name, entry(one.name, command));
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
