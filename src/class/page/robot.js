// The robot of one run: camera, map and output are the panels of the live page.

import { battery } from "/battery.js";
import { camera } from "/camera.js";
import { Connection } from "/connection.js";
import { h } from "/dom.js";
import { log } from "/log.js";
import { map } from "/map.js";
import { t } from "/texts.js";

/** Panels for the run below a path; `showLine` is called when a line of the output is chosen. */
export function robot(showLine = () => {}) {
  const connection = new Connection();
  const command = (what) => connection.command(what);
  const none = h("p", { class: "quiet card" }, t("no_run"));
  const output = log(connection, (_, line) => showLine(line));
  const level = battery(connection);
  const panels = h("div", { class: "panels", hidden: true }, camera(connection), map(connection, command), level);
  let shown = "";

  connection.on("hello", ({ role, world }) => {
    document.body.classList.toggle("viewer", role === "viewer");
    // A real robot has a battery to look after, and no map.
    panels.classList.toggle("real", !world);
    level.hidden = world;
    connection.watch({ map: true, log: true });
  });

  /** Shows this run, of which the state tells; another one replaces it. */
  function show(run, base = "/class") {
    const now = run?.open ? `${base} ${run.number}` : "";
    if (now === shown) {
      return;
    }
    shown = now;
    none.hidden = now !== "";
    panels.hidden = now === "";
    if (now === "") {
      return connection.close();
    }
    connection.reopen(base);
  }

  return {
    element: h("div", { class: "robot-view" }, none, panels), output, show, connection,
    speed: (factor) => command({ do: "sim", change: { sim: "speed", factor } }),
  };
}
