// Driving by hand: keys, a pad for touch and mouse, a gamepad. A setpoint is sent ten times a
// second and is valid for 0.3 s; the robot stops on release, when the page is hidden, or when the
// connection is lost.

import { h, remember, remembered, say, within } from "./dom.js";
import { t } from "./texts.js";

const PERIOD = 100;
const KEYS = {
  ArrowUp: [1, 0], KeyW: [1, 0], ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, -1], KeyA: [0, -1], ArrowRight: [0, 1], KeyD: [0, 1],
};
/** An untouched gamepad stick does not read exactly zero. */
const DEAD_ZONE = 0.15;

export function drive(connection, command, notice) {
  const pressed = new Map();
  let stick = null;
  let mine = false;
  let you = null;
  let resting = true;

  const power = h("input", {
    id: "power", type: "range", min: 10, max: 100, step: 5, value: remembered("power", "50"),
    oninput: () => remember("power", power.value),
  });
  const lock = h("button", { type: "button", class: "primary drive-lock", onclick: turn }, t("drive_take"));
  const knob = h("span", { class: "knob" });
  const pad = h("div", { class: "pad", role: "img", "aria-label": t("pad") }, knob);
  const hold = (key, where) => h("button", {
    type: "button", class: `arrow ${where}`, "aria-label": t(where),
    onpointerdown: () => press(`button ${where}`, KEYS[key]),
    onpointerup: () => release(`button ${where}`),
    onpointerleave: () => release(`button ${where}`),
    onpointercancel: () => release(`button ${where}`),
    onkeydown: (event) => (event.key === " " || event.key === "Enter") && press(`button ${where}`, KEYS[key]),
    onkeyup: () => release(`button ${where}`),
    onblur: () => release(`button ${where}`),
  }, { forward: "▲", backward: "▼", left: "◀", right: "▶" }[where]);
  const arrows = h("div", { class: "arrows" },
    hold("ArrowUp", "forward"), hold("ArrowLeft", "left"), hold("ArrowRight", "right"), hold("ArrowDown", "backward"));
  const who = h("p", { class: "quiet", role: "status" }, t("drive_hint"));

  function press(name, direction) {
    pressed.set(name, direction);
    if (mine) {
      beat();
    }
  }

  function release(name) {
    if (pressed.delete(name) && mine) {
      beat();
    }
  }

  function rest() {
    pressed.clear();
    stick = null;
    knob.style.transform = "";
  }

  function turn() {
    connection.send({ type: "drive_lock", take: !mine });
  }

  function leave() {
    rest();
    if (mine) {
      connection.send({ type: "drive", left: 0, right: 0 });
      connection.send({ type: "drive_lock", take: false });
    }
  }

  /** The current input: forward and to the right, each -1..1. */
  function wish() {
    if (stick) {
      return stick;
    }
    const sum = [...pressed.values()].reduce(([a, b], [c, d]) => [a + c, b + d], [0, 0]);
    if (sum[0] !== 0 || sum[1] !== 0) {
      return sum.map((one) => within(one, -1, 1));
    }
    const gamepad = navigator.getGamepads?.().find((one) => one?.connected);
    if (gamepad) {
      const axis = (number) => (Math.abs(number) > DEAD_ZONE ? number : 0);
      return [-axis(gamepad.axes[1] ?? 0), axis(gamepad.axes[0] ?? 0)];
    }
    return [0, 0];
  }

  function beat() {
    const [ahead, aside] = wish();
    const full = Number(power.value);
    const track = (sum) => Math.round(within(sum, -1, 1) * full);
    // Turning uses less power than driving.
    const [left, right] = [track(ahead + aside * 0.7), track(ahead - aside * 0.7)];
    const still = left === 0 && right === 0;
    if (!still || !resting) {
      connection.send({ type: "drive", left, right });
    }
    resting = still;
  }

  setInterval(() => mine && beat(), PERIOD);

  const typing = ({ target }) => target instanceof Element && target.closest("input, textarea, select, dialog") !== null;
  document.addEventListener("keydown", (event) => {
    const direction = KEYS[event.code];
    if (!mine || !direction || event.ctrlKey || event.metaKey || event.altKey || typing(event)) {
      return;
    }
    event.preventDefault();
    press(event.code, direction);
  });
  document.addEventListener("keyup", ({ code }) => release(code));
  window.addEventListener("blur", rest);
  document.addEventListener("visibilitychange", () => document.hidden && leave());
  window.addEventListener("pagehide", leave);

  function pull(event) {
    const { left, top, width, height } = pad.getBoundingClientRect();
    const reach = width / 2 - 28;
    const [x, y] = [event.clientX - left - width / 2, event.clientY - top - height / 2];
    const far = Math.max(1, Math.hypot(x, y) / reach);
    stick = [-y / reach / far, x / reach / far];
    knob.style.transform = `translate(${x / far}px, ${y / far}px)`;
  }
  pad.addEventListener("pointerdown", (event) => {
    if (mine) {
      pad.setPointerCapture(event.pointerId);
      pull(event);
      beat();
    }
  });
  pad.addEventListener("pointermove", (event) => stick && pull(event));
  for (const kind of ["pointerup", "pointercancel", "lostpointercapture"]) {
    pad.addEventListener(kind, () => {
      stick = null;
      knob.style.transform = "";
      if (mine) {
        beat();
      }
    });
  }

  connection.on("hello", (hello) => { you = hello.you; });
  connection.on("state", ({ driver, docked }) => {
    const had = mine;
    mine = driver !== null && driver.id === you;
    card.classList.toggle("mine", mine);
    say(lock, t(mine ? "drive_release" : "drive_take"));
    say(who, driver && !mine ? t("driving", { name: driver.name }) : t("drive_hint"));
    // There it does not drive, whatever is pressed.
    const waits = mine && docked;
    say(question, waits ? t("drive_docked") : "");
    station.classList.toggle("on", waits);
    if (had && !mine) {
      rest();
      resting = true;
    }
  });
  connection.on("lost", () => {
    mine = false;
    rest();
  });
  // What was held may be released meanwhile, unheard.
  connection.on("age", () => connection.late && rest());

  const dock = (what) => async () => {
    const { ok, text } = await command({ do: what });
    if (ok) {
      notice(t(`${what}_done`));
    }
    return text;
  };
  const question = h("span", { role: "status" });
  const station = h("div", { class: "station" }, question,
    h("button", { type: "button", onclick: dock("undock") }, t("undock")));
  const card = h("section", { class: "card drive driver-only", "aria-labelledby": "drive-title" },
    h("h2", { id: "drive-title" }, t("drive")),
    h("div", { class: "controls" }, pad, arrows, station),
    h("div", { class: "row" }, lock),
    h("div", { class: "row" }, h("label", { for: "power" }, t("power")), power),
    who,
    h("div", { class: "row" },
      h("button", { type: "button", onclick: dock("dock") }, t("dock")),
      h("button", { type: "button", onclick: dock("undock") }, t("undock"))));
  return card;
}
