// The battery: level, time left, and a plot.

import { h, s, say } from "./dom.js";
import { t } from "./texts.js";

const WIDTH = 320;
const HEIGHT = 96;
/** How long ago the robot told its level, if it is out of reach; else an empty text. */
export function age({ link, battery_age: seconds }) {
  if (link === "up" || seconds === null) {
    return "";
  }
  return seconds < 60 ? t("seconds_ago", { seconds }) : t("minutes_ago", { minutes: Math.floor(seconds / 60) });
}

/** The plot covers at least this many seconds. */
const SPAN = 600;

export function battery(connection) {
  const percent = h("span", { class: "figure" }, "–");
  const words = h("span", { class: "quiet" }, t("battery_unknown"));
  const area = s("path", { class: "area" });
  const line = s("path", { class: "line" });
  const low = s("line", { class: "mark", x1: 0, x2: WIDTH, y1: HEIGHT * 0.8, y2: HEIGHT * 0.8 });
  const plot = s("svg", {
    class: "plot", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img",
  }, low, area, line);
  const span = h("span", { class: "quiet" });
  let points = [];

  function draw() {
    const now = Date.now() / 1000;
    points = points.filter((point, index) => index > points.length - 900);
    const known = points.filter((point) => point.percent !== null);
    const first = Math.max(SPAN, now - (points[0]?.at ?? now));
    const x = (at) => (WIDTH * (1 - (now - at) / first)).toFixed(1);
    const y = (level) => (HEIGHT * (1 - level / 100)).toFixed(1);
    const last = known.at(-1);
    if (!last) {
      return;
    }
    const steps = known.map((point) => `${x(point.at)} ${y(point.percent)}`);
    steps.push(`${WIDTH} ${y(last.percent)}`);
    line.setAttribute("d", `M${steps.join("L")}`);
    area.setAttribute("d", `M${x(known[0].at)} ${HEIGHT}L${steps.join("L")}L${WIDTH} ${HEIGHT}Z`);
    const minutes = Math.round(first / 60);
    plot.setAttribute("aria-label", t("battery_plot", { minutes, percent: last.percent }));
    say(span, `−${minutes} min`);
  }

  connection.on("battery", (message) => {
    const now = Date.now() / 1000;
    points = message.points.map(([ago, level, charging]) => ({ at: now - ago, percent: level, charging }));
    draw();
  });
  connection.on("state", (state) => {
    const { battery: level, low: isLow } = state;
    card.classList.toggle("low", isLow);
    if (!level) {
      return;
    }
    say(percent, level.percent === null ? "?" : `${level.percent} %`);
    const minutes = level.minutes_left;
    const left = minutes === null ? "" : t(minutes === 1 ? "minute_left" : "minutes_left", { minutes });
    const unknown = level.charging ? t("charging_unknown") : t("level_unknown");
    const known = level.charging ? t("charging") : left;
    say(words, age(state) || (level.percent === null ? unknown : known));
    const last = points.at(-1);
    const now = Date.now() / 1000;
    if (!last || last.percent !== level.percent || now - last.at > 15) {
      points.push({ at: now, percent: level.percent, charging: level.charging });
    }
    draw();
  });

  const card = h("section", { class: "card battery", "aria-labelledby": "battery-title" },
    h("h2", { id: "battery-title" }, t("battery")),
    h("p", { class: "reading" }, percent, words),
    h("div", { class: "graph" },
      h("span", { class: "axis" }, h("span", {}, "100"), h("span", {}, "0")), plot),
    h("p", { class: "scale" }, span, h("span", { class: "quiet" }, "0")));
  return card;
}
