// The log: filtered by behaviour and level; a script's line links to its source.

import { h } from "./dom.js";
import { showScript } from "./script.js";
import { t } from "./texts.js";

const LEVELS = ["error", "warn", "info", "debug", "trace"];
const KEPT = 500;

/** Without the folder of a saved picture, which fills lines. */
const short = (text) => text.replace(/ picture=\S*\//, " picture=");

export function log(connection, show = showScript) {
  const list = h("ol", { class: "lines", "aria-label": t("log"), tabindex: 0 });
  const empty = h("p", { class: "quiet" }, t("log_empty"));
  const option = (value, text) => h("option", { value }, text);
  const level = h("select", { id: "log-level", onchange: filter },
    ...["error", "warn", "info", "debug"].map((name) => option(name, t(`level_${name}`))));
  level.value = "info";
  const behaviour = h("select", { id: "log-behaviour", onchange: filter }, option("", t("all")));
  const time = new Intl.DateTimeFormat(document.documentElement.lang, { hour: "2-digit", minute: "2-digit", second: "2-digit", hourCycle: "h23" });
  const names = new Set();

  const visible = (row) => {
    const deep = LEVELS.indexOf(row.dataset.level) <= LEVELS.indexOf(level.value === "debug" ? "trace" : level.value);
    return deep && (behaviour.value === "" || row.dataset.behaviour === behaviour.value);
  };

  function filter() {
    for (const row of list.children) {
      row.hidden = !visible(row);
    }
    list.scrollTop = list.scrollHeight;
  }

  function know(name) {
    if (name && !names.has(name)) {
      names.add(name);
      behaviour.append(option(name, name));
    }
  }

  function row(line) {
    const { at, level: kind, behaviour: name, line: number, text } = line;
    know(name);
    const where = name && number ? h("button", {
      type: "button", class: "link where", title: t("show_line", { line: number, name }),
      onclick: () => show(name, number),
    }, `${name}:${number}`) : name ? h("span", { class: "where" }, name) : null;
    const element = h("li", { class: kind, "data-level": kind, "data-behaviour": name ?? "" },
      h("time", {}, time.format(new Date(at))), where, h("span", { class: "text", title: text }, short(text)));
    element.hidden = !visible(element);
    return element;
  }

  connection.on("open", () => list.replaceChildren());
  connection.on("log", ({ lines, missed }) => {
    empty.hidden = true;
    const below = list.scrollHeight - list.scrollTop - list.clientHeight < 40;
    const rows = lines.map(row);
    if (missed > 0) {
      rows.unshift(h("li", { class: "warn", "data-level": "warn", "data-behaviour": "" }, t("log_missed", { count: missed })));
    }
    list.append(...rows);
    while (list.children.length > KEPT) {
      list.firstElementChild.remove();
    }
    if (below) {
      list.scrollTop = list.scrollHeight;
    }
  });

  return h("section", { class: "card log", "aria-labelledby": "log-title" },
    h("div", { class: "head" }, h("h2", { id: "log-title" }, t("log")),
      h("div", { class: "row filters" },
        h("span", { class: "check" }, h("label", { for: "log-level" }, t("level")), level),
        h("span", { class: "check" }, h("label", { for: "log-behaviour" }, t("behaviour")), behaviour))),
    empty, list);
}
