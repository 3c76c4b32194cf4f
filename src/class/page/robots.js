// The real robots, for the teacher: a card for each with its camera and STOP, and who waits for a turn.

import { Connection } from "/connection.js";
import { h, say } from "/dom.js";
import { t } from "/texts.js";
import { minutes } from "./turns.js";

/** `post` sends a request; `nameOf` is how a learner is shown. */
export function robots(post, nameOf) {
  const cards = h("div", { class: "robots" });
  const queue = h("ol", { class: "queue" });
  const nobody = h("p", { class: "quiet" }, t("nobody_waits"));
  const length = h("input", {
    id: "turn-minutes", type: "number", min: 1, max: 30, required: true,
    onchange: () => length.reportValidity() && post("minutes", { minutes: Number(length.value) }),
  });
  const element = h("section", { class: "card real-robots", "aria-labelledby": "robots-title", hidden: true },
    h("div", { class: "head" }, h("h2", { id: "robots-title" }, t("real_robots")),
      h("span", { class: "row" }, h("label", { for: "turn-minutes" }, t("turn_minutes")), length)),
    h("div", { class: "fleet" }, cards, h("div", {}, h("h3", {}, t("queue")), nobody, queue)));
  const made = new Map();

  function card(name) {
    const path = `robots/${encodeURIComponent(name)}`;
    const connection = new Connection(`/class/${path}`);
    const image = h("img", { class: "view", alt: t("camera_of", { name }), hidden: true });
    connection.on("frame", ({ jpeg }) => {
      URL.revokeObjectURL(image.src);
      image.src = URL.createObjectURL(new Blob([jpeg], { type: "image/jpeg" }));
      image.hidden = false;
      connection.send({ type: "frame_shown" });
    });
    connection.watch({ camera: true });
    connection.connect();
    const [state, battery, driver] = [h("p", { class: "state" }), h("p", { class: "quiet" }), h("p", {})];
    const stop = h("button", { type: "button", class: "stop", "aria-label": t("stop_robot", { name }), onclick: () => post(`${path}/stop`, { on: true }) }, t("stop"));
    const release = h("button", { type: "button", class: "reset-stop", onclick: () => post(`${path}/stop`, { on: false }) }, t("reset_stop"));
    const whole = h("article", { "aria-label": name }, image,
      h("div", { class: "facts" }, h("h3", {}, name), state, driver, battery, h("div", { class: "row" }, stop, release)));
    return { whole, state, battery, driver, release };
  }

  function fill({ name, state, percent, charging, stopped, driver, left }) {
    if (!made.has(name)) {
      made.set(name, card(name));
    }
    const one = made.get(name);
    say(one.state, t(`robot_${state}`));
    one.state.className = `state ${state.startsWith("stop_") || state === "disconnected" ? "bad" : ["ready", "docked", "turn", "drives"].includes(state) ? "good" : "warn"}`;
    const level = percent === null ? t("battery_unknown") : `${percent} %`;
    say(one.battery, `${t("battery")}: ${level}${charging ? `, ${t("charging")}` : ""}`);
    say(one.driver, driver === null ? "" : t("turn_of", { name: nameOf(driver), left: minutes(left) }));
    one.release.hidden = !stopped;
    return one.whole;
  }

  return {
    element,
    show({ robots: all, waiting, minutes: chosen }) {
      element.hidden = all.length === 0;
      const shown = all.map(fill);
      if (cards.childElementCount !== shown.length) {
        cards.replaceChildren(...shown);
      }
      if (document.activeElement !== length) {
        length.value = chosen;
      }
      const names = waiting.map(nameOf);
      nobody.hidden = names.length > 0;
      if (queue.dataset.names !== names.join("\n")) {
        queue.dataset.names = names.join("\n");
        queue.replaceChildren(...names.map((name) => h("li", {}, name)));
      }
    },
  };
}
