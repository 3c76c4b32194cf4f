// The robot, drawn from above: lights, tracks, sounds and log lines; and controls for lights and
// sounds.

import { h, s, say } from "./dom.js";
import { t } from "./texts.js";

const SOUNDS = ["alarm", "bomb", "laser", "laugh", "engine", "robot", "bip_2", "bip_3", "bip_4", "music"];
const LIGHTS = ["flash", "left", "right"];
/** How long a sound or a log line is shown, in milliseconds. */
const SHOWN = 4000;

export function robot(connection, command) {
  const bar = (x) => s("rect", { class: "power", x, y: 70, width: 10, height: 0, rx: 5 });
  const bars = [bar(21), bar(109)];
  const lamp = (x, y, radius) => s("circle", { class: "lamp", cx: x, cy: y, r: radius });
  const lamps = [lamp(70, 34, 9), lamp(50, 104, 5), lamp(90, 104, 5)];
  const drawing = s("svg", { class: "drawing", viewBox: "0 0 140 140", role: "img" },
    s("rect", { class: "track", x: 16, y: 16, width: 20, height: 108, rx: 10 }),
    s("rect", { class: "track", x: 104, y: 16, width: 20, height: 108, rx: 10 }),
    ...bars,
    s("rect", { class: "body", x: 38, y: 14, width: 64, height: 112, rx: 26 }),
    s("path", { class: "face", d: "M52 58 Q70 50 88 58 L88 88 Q70 94 52 88 Z" }),
    ...lamps);
  const bubble = h("p", { class: "bubble", "aria-live": "off" });
  const figures = [h("strong", {}, "0"), h("strong", {}, "0")];
  const delays = h("p", { class: "note delays", hidden: true });
  let quiet = null;
  let sounds = null;

  function speak(text) {
    say(bubble, text);
    bubble.classList.add("on");
    clearTimeout(quiet);
    quiet = setTimeout(() => bubble.classList.remove("on"), SHOWN);
  }

  const switches = LIGHTS.map((light) => h("button", {
    type: "button", class: "switch", "aria-pressed": "false",
    onclick: ({ currentTarget }) => {
      command({ do: "led", light, on: currentTarget.getAttribute("aria-pressed") !== "true" });
    },
  }, t(`light_${light}`)));

  connection.on("state", (state) => {
    state.tracks.forEach((power, index) => {
      const length = Math.abs(power) * 0.5;
      bars[index].setAttribute("y", power >= 0 ? 70 - length : 70);
      bars[index].setAttribute("height", length);
      say(figures[index], `${power} %`);
    });
    state.lights.forEach((on, index) => {
      lamps[index].classList.toggle("on", on === true);
      switches[index].setAttribute("aria-pressed", String(on === true));
    });
    const on = LIGHTS.filter((_, index) => state.lights[index] === true).map((light) => t(`light_${light}`));
    const lights = on.length ? on.join(", ") : t("lights_none");
    const [left, right] = state.tracks;
    drawing.setAttribute("aria-label", t("robot_alt", { lights, left, right }));
    if (sounds !== null && sounds !== state.sounds && state.sound) {
      speak(`♪ ${state.sound}`);
    }
    sounds = state.sounds;
    // How late the robot is, unless its program does not answer.
    delays.hidden = !state.delays;
    if (state.delays) {
      const seconds = (time) => `${time.toFixed(2)} s`;
      say(delays, t("delays", { robot: seconds(state.delays.robot), network: seconds(state.delays.network) }));
    }
  });
  connection.on("log", ({ lines }) => {
    const last = lines.findLast((line) => line.behaviour && line.level === "info" && line.line);
    if (last && Date.now() - last.at < SHOWN) {
      speak(last.text.slice(0, 120));
    }
  });

  const sound = h("select", { id: "sound" }, ...SOUNDS.map((name) => h("option", {}, name)));
  const volume = h("input", {
    id: "volume", type: "range", min: 0, max: 100, value: 50, step: 5,
    onchange: () => command({ do: "volume", percent: Number(volume.value) }),
  });
  return h("section", { class: "card robot", "aria-labelledby": "robot-title" },
    h("h2", { id: "robot-title" }, t("robot")),
    h("div", { class: "figure-row" },
      h("div", { class: "portrait" }, drawing, bubble),
      h("dl", { class: "facts" },
        h("dt", {}, t("left")), h("dd", {}, figures[0]),
        h("dt", {}, t("right")), h("dd", {}, figures[1]))),
    delays,
    h("div", { class: "row lights driver-only" }, ...switches),
    h("div", { class: "row driver-only" },
      h("label", { for: "sound" }, t("sound")), sound,
      h("button", { type: "button", onclick: () => command({ do: "play", sound: sound.value }) }, t("play"))),
    h("div", { class: "row driver-only" }, h("label", { for: "volume" }, t("volume")), volume));
}
