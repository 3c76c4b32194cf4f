// Controls for the simulated world, with the operations of scenarios.

import { h, say } from "./dom.js";
import { t } from "./texts.js";

const FAULTS = {
  drop: {}, delay: { seconds: 0.5, for: 30 }, half_open: { for: 20 }, reboot: { for: 10 },
  take_over: { for: 10 }, truncated_frames: { for: 30 }, flipped_frames: { for: 30 },
  no_power: { for: 60 }, power_jumps: { for: 30 }, dock_lost: { for: 60 },
};

const SPEEDS = [0.25, 0.5, 1, 2, 5, 10, 20, 50, 100];

/** The simulation's own clock, if it has one. */
function clock(connection, change) {
  let paused = false;
  const pause = h("button", { type: "button", onclick: () => change({ sim: "pause", paused: !paused }) }, t("sim_pause"));
  const step = h("button", { type: "button", onclick: () => change({ sim: "step" }) }, t("sim_step"));
  const speed = h("select", { id: "sim-speed", onchange: () => change({ sim: "speed", factor: Number(speed.value) }) },
    ...SPEEDS.map((factor) => h("option", { value: factor }, `${factor}x`)));
  const row = h("div", { class: "row", hidden: true }, pause, step,
    h("label", { for: "sim-speed" }, t("sim_speed")), speed);
  const none = h("p", { class: "quiet" }, t("sim_no_clock"));
  connection.on("map", ({ clock: now }) => {
    row.hidden = now === null;
    none.hidden = now !== null;
    if (now) {
      paused = now.paused;
      say(pause, t(paused ? "sim_go_on" : "sim_pause"));
      if (document.activeElement !== speed) {
        speed.value = String(now.factor);
      }
    }
  });
  return [row, none];
}

export function simulation(connection, command) {
  const change = (what) => command({ do: "sim", change: what });
  const battery = h("input", {
    id: "sim-battery", type: "range", min: 0, max: 100, step: 1, value: 100,
    onchange: () => change({ sim: "battery", percent: Number(battery.value) }),
  });
  const light = h("input", {
    id: "sim-light", type: "range", min: 0, max: 2, step: 0.05, value: 1,
    onchange: () => change({ sim: "light", factor: Number(light.value) }),
  });
  const check = (id, key, done) => {
    const input = h("input", { id, type: "checkbox", onchange: () => change(done(input.checked)) });
    return h("label", { class: "check", for: id }, input, t(key));
  };
  const fault = h("select", { id: "sim-fault" },
    ...Object.keys(FAULTS).map((name) => h("option", { value: name }, t(`fault_${name}`))));
  const number = (id, key, step) => {
    const input = h("input", { id, type: "number", step, value: 1 });
    return [input, h("span", { class: "field" }, h("label", { for: id }, t(key)), input)];
  };
  const [px, fieldX] = number("sim-x", "metres_x", 0.1);
  const [py, fieldY] = number("sim-y", "metres_y", 0.1);
  const [heading, fieldHeading] = number("sim-heading", "degrees", 15);
  heading.value = 0;
  const what = h("select", { id: "sim-what" }, h("option", { value: "0" }, t("robot")));
  const put = () => {
    const [x, y, index] = [Number(px.value), Number(py.value), Number(what.value)];
    const angle = Number(heading.value) * Math.PI / 180;
    change(index === 0 ? { sim: "place", x, y, heading: angle } : { sim: "place_ball", number: index, x, y });
  };

  let touched = false;
  battery.addEventListener("input", () => { touched = true; });
  connection.on("map", (message) => {
    if (!touched) {
      battery.value = message.battery;
    }
    touched = document.activeElement === battery;
  });
  connection.on("world", ({ balls }) => {
    const options = balls.map((_, index) => h("option", { value: index + 1 }, `${index + 1} ●`));
    what.replaceChildren(h("option", { value: "0" }, t("robot")), ...options);
  });

  return h("section", { class: "card simulation driver-only", "aria-labelledby": "simulation-title" },
    h("h2", { id: "simulation-title" }, t("simulation")),
    ...clock(connection, change),
    h("div", { class: "row" }, h("label", { for: "sim-battery" }, t("sim_battery")), battery),
    h("div", { class: "row" }, h("label", { for: "sim-light" }, t("sim_light")), light),
    h("div", { class: "row" },
      check("sim-hide", "sim_hide", (hidden) => ({ sim: "hide_station", hidden })),
      check("sim-charger", "sim_charger", (broken) => ({ sim: "break_charger", broken }))),
    h("div", { class: "row" },
      h("label", { for: "sim-fault" }, t("sim_fault")), fault,
      h("button", { type: "button", onclick: () => change({ sim: "fault", fault: { fault: fault.value, ...FAULTS[fault.value] } }) }, t("sim_begin"))),
    h("div", { class: "row" },
      h("button", { type: "button", onclick: () => change({ sim: "clear_faults" }) }, t("sim_clear")),
      h("button", { type: "button", onclick: () => change({ sim: "noise", dbfs: -10, seconds: 0.5 }) }, t("sim_noise"))),
    h("div", { class: "row fields" },
      h("span", { class: "field" }, h("label", { for: "sim-what" }, t("sim_what")), what),
      fieldX, fieldY, fieldHeading,
      h("button", { type: "button", onclick: put }, t("sim_put"))));
}
