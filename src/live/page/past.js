// History and timetable of a service.

import { h, s, say } from "./dom.js";
import { t } from "./texts.js";

const WIDTH = 600;
const HEIGHT = 110;
/** Refresh interval of both, in milliseconds. */
const AGAIN = 60_000;
const PICTURES = 8;
/** Results of dockings and undockings that are not failures. */
const GOOD = ["done", "already_docked", "not_docked"];

async function ask(path) {
  const answer = await fetch(path).catch(() => null);
  return answer?.ok ? answer.json() : null;
}

/** Returns the text of a code, or the code itself if it has none. */
const word = (prefix, name) => {
  const key = `${prefix}_${name}`;
  const text = t(key);
  return text === key ? name.replaceAll("_", " ") : text;
};

function plot(battery, since, until) {
  const x = (at) => (WIDTH * (at - since) / Math.max(1, until - since)).toFixed(1);
  const y = (percent) => (HEIGHT * (1 - percent / 100)).toFixed(1);
  const steps = battery.map(([at, percent]) => `${x(at)} ${y(percent)}`);
  const charging = battery.flatMap(([at, , is], index) => {
    const next = battery[index + 1]?.[0] ?? until;
    return is ? [s("rect", { class: "charging", x: x(at), y: HEIGHT - 4, width: Math.max(0.5, x(next) - x(at)), height: 4 })] : [];
  });
  return [...charging, s("path", { class: "line", d: steps.length ? `M${steps.join("L")}` : "" })];
}

/** A mark for each docking and alarm, on the plot's upper edge. */
function marks(events, since, until) {
  const x = (at) => WIDTH * (at - since) / Math.max(1, until - since);
  return events.filter(({ kind }) => kind === "dock" || kind === "safety").map(({ at, kind, code }) => s("rect", {
    class: kind === "dock" && GOOD.includes(code) ? "event" : "event bad", x: x(at) - 1, y: 0, width: 2.5, height: 10,
  }));
}

function row({ at, kind, behaviour, code, text }, time) {
  const what = [word("event", kind), behaviour, code ? word("code", code) : ""].filter((one) => one).join(" · ");
  const bad = kind === "given_up" || kind === "safety" || (kind === "dock" && !GOOD.includes(code));
  return h("li", { class: bad && "bad" },
    h("time", {}, time.format(new Date(at))), h("span", { class: "text" }, text && kind !== "picture" ? `${what}: ${text}` : what));
}

function picture({ at, behaviour, text }, time) {
  const src = `/api/behaviours/${encodeURIComponent(behaviour)}/pictures/${encodeURIComponent(text)}`;
  const when = time.format(new Date(at));
  const image = h("img", { src, alt: t("picture_of", { name: behaviour, when }), loading: "lazy" });
  const link = h("a", { href: src, target: "_blank", rel: "noopener" }, image);
  // The picture may have been deleted to make room for newer ones.
  image.addEventListener("error", () => link.remove());
  return link;
}

export function past(connection) {
  const language = document.documentElement.lang;
  const time = new Intl.DateTimeFormat(language, { weekday: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  const day = new Intl.DateTimeFormat(language, { day: "numeric", month: "short", hour: "2-digit", minute: "2-digit", hourCycle: "h23" });
  const drawing = s("svg", { class: "plot", viewBox: `0 0 ${WIDTH} ${HEIGHT}`, preserveAspectRatio: "none", role: "img" });
  const [from, to] = [h("span", { class: "quiet" }), h("span", { class: "quiet" })];
  const pictures = h("div", { class: "pictures" });
  const events = h("ol", { class: "events", tabindex: 0, "aria-label": t("history") });
  const days = h("select", { id: "past-days", onchange: show },
    ...[1, 3, 7, 31].map((count) => h("option", { value: count }, t("days", { count }))));
  let timer = null;

  async function show() {
    clearTimeout(timer);
    timer = setTimeout(show, AGAIN);
    const told = document.hidden && !card.hidden ? null : await ask(`/api/history?days=${days.value}`);
    if (!told) {
      return;
    }
    card.hidden = false;
    // A new journal does not cover all the days asked for.
    const first = Math.min(told.battery[0]?.[0] ?? told.until, told.events[0]?.at ?? told.until);
    const since = Math.max(told.since, first);
    drawing.replaceChildren(...plot(told.battery, since, told.until), ...marks(told.events, since, told.until));
    const docks = told.events.filter(({ kind }) => kind === "dock").length;
    const alarms = told.events.filter(({ kind, code }) => kind === "safety" && code === "alarm").length;
    drawing.setAttribute("aria-label", t("history_alt", { from: day.format(new Date(since)), docks, alarms }));
    say(from, day.format(new Date(since)));
    say(to, day.format(new Date(told.until)));
    const kept = told.events.filter(({ kind, text }) => kind === "picture" && text).slice(-PICTURES).reverse();
    pictures.replaceChildren(...kept.map((one) => picture(one, time)));
    events.replaceChildren(...told.events.toReversed().map((one) => row(one, time)));
  }

  const card = h("section", { class: "card past", "aria-labelledby": "past-title", hidden: true },
    h("div", { class: "head" }, h("h2", { id: "past-title" }, t("history")),
      h("div", { class: "row filters" }, h("label", { for: "past-days" }, t("history_of")), days)),
    h("div", { class: "graph" }, h("span", { class: "axis" }, h("span", {}, "100"), h("span", {}, "0")), drawing),
    h("p", { class: "scale" }, from, to), pictures, events);
  connection.on("hello", show);
  return card;
}

/** Shortens an end such as `Sun 2026-03-29 01:30` to the time if it is on the day of the start. */
const ending = (at, until) => (until.slice(0, -5) === at.slice(0, -5) ? until.slice(-5) : until);

export function schedule(connection) {
  const list = h("ol", { class: "starts" });
  let timer = null;

  async function show() {
    clearTimeout(timer);
    timer = setTimeout(show, AGAIN);
    const starts = document.hidden && !card.hidden ? null : await ask("/api/schedule");
    if (!starts) {
      return;
    }
    card.hidden = false;
    list.replaceChildren(...starts.map(({ at, run, until, notes }) => h("li", {},
      h("time", {}, at), h("strong", {}, run),
      h("span", { class: "quiet" }, [until ? t("until", { time: ending(at, until) }) : "", ...notes.map((note) => t(`start_${note}`))].filter((one) => one).join(" · ")))));
  }

  const card = h("section", { class: "card schedule", "aria-labelledby": "schedule-title", hidden: true },
    h("h2", { id: "schedule-title" }, t("schedule")), list);
  connection.on("hello", show);
  return card;
}
